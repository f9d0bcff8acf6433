"""Post-encroachment time (PET): how long after one vehicle another one was at the same place."""

from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.spatial import cKDTree

from siren_ros.numerics.arrays import Floats
from siren_ros.numerics.geometry import footprint_corners, separation_m, wrap_angle
from siren_ros.numerics.units import STEP_S
from siren_ros.recording.episode_record import StateRows

CROSSING_MIN_RAD: Final = float(np.radians(30.0))
"""Ways that meet at a smaller angle are one behind the other: their time gap is headway, not encroachment."""


@dataclass(frozen=True)
class Encroachment:
    """The closest encroachment of two tracks."""

    time_s: float
    """PET: from the moment at which the first left a place to the moment at which the second reached it."""
    step: int
    """Step at which the second reached the place."""
    subject_first: bool
    """Whether the subject was there first."""


def post_encroachment(
    subject: StateRows,
    other: StateRows,
    subject_size_m: tuple[float, float],
    other_size_m: tuple[float, float],
    crossing_min_rad: float = CROSSING_MIN_RAD,
) -> Encroachment | None:
    """Least PET of two tracks whose ways cross or meet head-on, from their footprints; None where none overlap.

    PET after Allen, Shin and Cooper (1978), with the places that both footprints covered instead of one conflict area,
    so that long vehicles and shallow angles count as they are.

    Args:
        subject: Track of one actor.
        other: Track of the other.
        subject_size_m: Length and width.
        other_size_m: The same of the other.
        crossing_min_rad: Least angle between the two headings; below it the two follow each other.
    """
    if not len(subject) or not len(other):
        return None
    reach = 0.5 * float(np.hypot(*subject_size_m) + np.hypot(*other_size_m))
    pairs = cKDTree(subject.xy_m).sparse_distance_matrix(cKDTree(other.xy_m), reach, output_type="ndarray")
    mine, theirs = pairs["i"], pairs["j"]
    crossing = np.abs(wrap_angle(subject.yaw_rad[mine] - other.yaw_rad[theirs])) >= crossing_min_rad
    mine, theirs = mine[crossing], theirs[crossing]
    apart = (
        separation_m(_corners(subject.select(mine), subject_size_m), _corners(other.select(theirs), other_size_m))
        if len(mine)
        else np.empty(0)
    )
    both = apart < 0.0
    if not both.any():
        return None
    first, second = subject.step[mine[both]], other.step[theirs[both]]
    delay = np.abs(first - second)
    # Of equal delays the earliest.
    best = int(np.lexsort((np.maximum(first, second), delay))[0])
    return Encroachment(
        float(delay[best] * STEP_S), int(max(first[best], second[best])), bool(first[best] < second[best])
    )


def _corners(states: StateRows, size_m: tuple[float, float]) -> Floats:
    length, width = (np.full(len(states), side) for side in size_m)
    return footprint_corners(states.x_m, states.y_m, states.yaw_rad, length, width)
