"""The wake: how long and how far traffic stays disturbed after the EMV has passed."""

from collections.abc import Sequence

import numpy as np

from siren_ros.evaluation.yielding.encounters import Encounter
from siren_ros.evaluation.yielding.marks.driver import disturbed_rows, recovery_time_s
from siren_ros.evaluation.yielding.measure import Measure
from siren_ros.evaluation.yielding.thresholds import YieldThresholds

_NOBODY = "the EMV passed nobody"


def wake_duration_s(encounters: Sequence[Encounter], limits: YieldThresholds) -> Measure:
    """Longest time from a driver's passing until it has recovered; a lower bound where the episode ends before."""
    times = [recovery_time_s(one, limits) for one in encounters if one.passed_row >= 0]
    if not times:
        return Measure.lacking(_NOBODY)
    longest = max(times, key=lambda time: time.value)
    return Measure(longest.value, at_least=any(time.at_least for time in times))


def wake_length_m(encounters: Sequence[Encounter], limits: YieldThresholds) -> Measure:
    """Largest distance along the line between the EMV and a driver behind it that has not recovered."""
    farthest, found = 0.0, False
    for one in encounters:
        if one.passed_row < 0:
            continue
        found = True
        after = slice(one.passed_row, None)
        behind = (one.emv.arc_m - one.driver.arc_m)[after]
        farthest = max(farthest, float(np.max(behind, where=disturbed_rows(one, limits)[after], initial=0.0)))
    return Measure(farthest) if found else Measure.lacking(_NOBODY)
