"""Arithmetic of single numbers, for compiled loops; ``geometry.wrap_angle`` and ``numpy.clip`` are for arrays."""

import numpy as np

from siren_ros.numerics.compiled import compiled


@compiled
def wrapped_rad(angle_rad: float) -> float:
    """The same direction within (−π, π]."""
    angle = (angle_rad + np.pi) % (2.0 * np.pi) - np.pi
    return np.pi if angle == -np.pi else angle


@compiled
def within(value: float, low: float, high: float) -> float:
    """The nearest value between two bounds."""
    return min(max(value, low), high)
