"""What a monitor finds of a driver's conduct, and helpers that monitors share."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from siren_ros.base.numerics.arrays import Flags, Floats
from siren_ros.base.numerics.units import STEP_S
from siren_ros.base.tables import Measure
from siren_ros.reports.exam.examinee import Examinee
from siren_ros.scoring.judging.surrogate_safety import longest_run

Numbers = Mapping[str, float]
STANDS_MPS: Final = 0.5
"""A vehicle that is slower than this stands (``YieldThresholds.stop_mps``)."""
M: Final = (0.0, 100.0)
S: Final = (0.0, 60.0)
MPS: Final = (0.0, 40.0)
"""Least and greatest values of a clause's numbers, by unit."""


@dataclass(frozen=True)
class Finding:
    """What a monitor found."""

    measure: Measure
    step: int | None = None
    """The step that decides: the worst one, or the first of the worst stretch."""
    about: str = ""
    """Class and id of the other actor, where one is involved."""


@dataclass(frozen=True)
class Monitor:
    """A monitor and the numbers that a clause has to give it, with their least and greatest values."""

    find: Callable[[Examinee, Numbers], Finding]
    unit: str
    meaning: str
    numbers: Mapping[str, tuple[float, float]]
    asks_to_act: bool = False
    """Whether the driver has to act once it notices a siren: a grave violation is one by the latest notice, too."""


def greatest(examinee: Examinee, values: Floats, counts: Flags, lack: str) -> Finding:
    """The greatest of the values that count."""
    if not counts.any():
        return Finding(Measure.lacking(lack))
    worst = int(np.argmax(np.where(counts, values, -np.inf)))
    return Finding(Measure(float(values[worst])), int(examinee.track.step[worst]))


def first_step(examinee: Examinee, holds: Flags) -> int | None:
    """The first step at which a condition holds."""
    return int(examinee.track.step[int(np.argmax(holds))]) if holds.any() else None


def longest(examinee: Examinee, holds: Flags) -> Finding:
    """The longest time for which a condition holds without interruption, and the step at which that begins."""
    run = longest_run(holds, examinee.track.step)
    return Finding(Measure(len(run) * STEP_S), int(run[0]) if len(run) else None)


def least_of_last(values: Floats, steps: int) -> Floats:
    """The least of each value and of those at so many steps before it."""
    return np.asarray(
        np.min([np.concatenate((np.full(k, np.inf), values))[: len(values)] for k in range(steps + 1)], axis=0)
    )
