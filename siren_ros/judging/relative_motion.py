"""Where one vehicle is in the axes of another, step by step."""

from typing import Final

import numpy as np
import numpy.typing as npt

from siren_ros.numerics.arrays import Floats
from siren_ros.numerics.geometry import wrap_angle
from siren_ros.recording.episode_record import StateRows

ALIGNED_RAD: Final = np.pi / 3.0
"""Two vehicles drive in the same direction where their headings differ by less."""


def common_rows(first: StateRows, second: StateRows) -> tuple[StateRows, StateRows]:
    """The rows of two tracks at the steps that both have, in the order of time."""
    _, in_first, in_second = np.intersect1d(first.step, second.step, assume_unique=True, return_indices=True)
    return first.select(in_first), second.select(in_second)


def ahead_and_left_m(observer: StateRows, other: StateRows) -> tuple[Floats, Floats]:
    """The other's centre in the observer's axes; rows of the same steps, arrays of shape ``(M,)``."""
    delta = other.xy_m - observer.xy_m
    cos, sin = np.cos(observer.yaw_rad), np.sin(observer.yaw_rad)
    ahead_m: Floats = delta[:, 0] * cos + delta[:, 1] * sin
    left_m: Floats = delta[:, 1] * cos - delta[:, 0] * sin
    return ahead_m, left_m


def in_same_direction(observer: StateRows, other: StateRows) -> npt.NDArray[np.bool_]:
    """Whether the headings differ by less than ``ALIGNED_RAD``; rows of the same steps."""
    aligned: npt.NDArray[np.bool_] = np.abs(wrap_angle(other.yaw_rad - observer.yaw_rad)) < ALIGNED_RAD
    return aligned
