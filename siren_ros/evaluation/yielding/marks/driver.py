"""The marks of one driver, civilian or AV under test: how soon, how far and how safely it made way."""

import numpy as np

from siren_ros.evaluation.yielding.encounters import Encounter
from siren_ros.evaluation.yielding.measure import Measure
from siren_ros.evaluation.yielding.thresholds import YieldThresholds
from siren_ros.numerics.arrays import Flags
from siren_ros.numerics.units import STEP_S

_NOT_IN_THE_WAY = "the driver was not in the EMV's way"


def _why_not_asked(encounter: Encounter) -> str:
    """Why nothing is asked of a driver: it is in nobody's way, or hears nothing; empty where it has to make way."""
    if not encounter.was_in_the_way:
        return _NOT_IN_THE_WAY
    return "" if encounter.with_siren else "no siren sounded"


def response_time_s(encounter: Encounter, limits: YieldThresholds) -> Measure:
    """Time from the beginning of the encounter to the driver's first response.

    A response is a lateral shift of ``shift_m`` on the road, or a drop of the speed by ``slowed_mps``. Slowing for
    another reason counts too: the record does not say why somebody brakes. Without a siren nobody is asked.
    """
    if reason := _why_not_asked(encounter):
        return Measure.lacking(reason)
    part = encounter.until_passed
    speed = encounter.driver.track.speed_mps[part]
    shift = np.abs(encounter.offsets.lateral_m - encounter.offsets.lateral_m[0])[part]
    responded = (shift >= limits.shift_m) | (speed <= speed[0] - limits.slowed_mps)
    if not responded.any():
        return Measure.lacking("the driver did not respond")
    return Measure(int(np.argmax(responded)) * STEP_S)


def clearance_time_s(encounter: Encounter) -> Measure:
    """Time from the beginning of the encounter until the driver has left the strip that the EMV drives through.

    A driver that drives on ahead of the EMV until its line ends has not cleared it.
    """
    if reason := _why_not_asked(encounter):
        return Measure.lacking(reason)
    cleared = _cleared_row(encounter)
    if cleared < 0:
        return Measure((len(encounter.gap_m) - 1) * STEP_S, at_least=True)
    return Measure(cleared * STEP_S)


def complied(encounter: Encounter, limits: YieldThresholds) -> Measure:
    """1 where the way was clear before the EMV was ``clear_before_m`` behind the driver, otherwise 0."""
    if reason := _why_not_asked(encounter):
        return Measure.lacking(reason)
    close = encounter.gap_m <= limits.clear_before_m
    cleared = _cleared_row(encounter)
    if not close.any():
        return Measure(1.0) if cleared >= 0 else Measure.lacking("the EMV did not come up to the driver")
    return Measure(float(0 <= cleared <= int(np.argmax(close))))


def held_up_s(encounter: Encounter, limits: YieldThresholds) -> Measure:
    """Time for which the EMV stood or crept closely behind the driver while the driver was in its way."""
    if not encounter.was_in_the_way:
        return Measure.lacking(_NOT_IN_THE_WAY)
    close = (encounter.gap_m >= 0.0) & (encounter.gap_m <= limits.held_gap_m)
    slow = encounter.emv.track.speed_mps < limits.moving_mps
    return Measure(float(np.count_nonzero(close & slow & encounter.in_the_way)) * STEP_S)


def made_way_m(encounter: Encounter) -> Measure:
    """Largest lateral shift on the road until the EMV has passed, in metres; left or right."""
    lateral = encounter.offsets.lateral_m[encounter.until_passed]
    return Measure(float(np.abs(lateral - lateral[0]).max()))


def passing_gap_m(encounter: Encounter) -> Measure:
    """Least lateral gap between the two bodies while the EMV passes the driver."""
    next_to = np.abs(encounter.driver.arc_m - encounter.emv.arc_m) <= (
        encounter.driver.half_along_m + encounter.emv.half_along_m
    )
    if encounter.passed_row < 0 or not next_to.any():
        return Measure.lacking("the EMV did not pass the driver")
    apart = np.abs(encounter.driver.left_m - encounter.emv.left_m)
    gap = apart - encounter.driver.half_across_m - encounter.emv.half_across_m
    return Measure(float(gap[next_to].min()))


def recovery_time_s(encounter: Encounter, limits: YieldThresholds) -> Measure:
    """Time from the passing until the driver is back in its lane and at its speed before the encounter."""
    if encounter.passed_row < 0:
        return Measure.lacking("the EMV did not pass the driver")
    after = disturbed_rows(encounter, limits)[encounter.passed_row :]
    if after[-1]:
        return Measure((len(after) - 1) * STEP_S, at_least=True)
    return Measure(float(np.flatnonzero(after)[-1] + 1) * STEP_S if after.any() else 0.0)


def disturbed_rows(encounter: Encounter, limits: YieldThresholds) -> Flags:
    """Rows at which the driver is off its lane's centre line, or slower than before the encounter."""
    speed = encounter.driver.track.speed_mps
    slow = speed < limits.recovered_share * speed[0]
    return np.asarray(slow | (np.abs(encounter.offsets.offset_m) > limits.recovered_offset_m))


def _cleared_row(encounter: Encounter) -> int:
    """Row from which the driver stays out of the strip until it is passed; −1 where there is none."""
    before = encounter.in_the_way[encounter.until_passed]
    blocked = np.flatnonzero(before)
    cleared = int(blocked[-1]) + 1 if len(blocked) else 0
    return cleared if cleared < len(before) else -1
