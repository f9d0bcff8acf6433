"""How fast a path may be driven: bends limit the speed, and vehicles brake comfortably before them."""

import math
from typing import Final

import numpy as np
import numpy.typing as npt

from siren_ros.numerics.geometry import Polyline, wrap_angle

SAMPLE_M: Final = 1.0
"""Distance between the samples of a speed profile."""
_HALF_WINDOW_M: Final = 2.0
"""Curvature is the change of heading over twice this length, less than the wheelbase of a bus. A corner of the polyline
is a bend of this length."""
_LEAST_CURVATURE_1PM: Final = 1e-6

Speeds = npt.NDArray[np.float64]


def curvature_1pm(path: Polyline, s_m: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Unsigned curvature of a path at arc lengths, shape of ``s_m``; near the ends over a shorter window."""
    before = np.clip(s_m - _HALF_WINDOW_M, 0.0, path.length_m)
    after = np.clip(s_m + _HALF_WINDOW_M, 0.0, path.length_m)
    turned = np.abs(wrap_angle(path.heading_rad(after) - path.heading_rad(before)))
    return np.asarray(turned / np.maximum(after - before, SAMPLE_M))


def bend_speeds_mps(path: Polyline, lateral_accel_mps2: float) -> Speeds:
    """Speed at which each metre of a path takes a lateral acceleration: ``sqrt(a / curvature)``, shape ``(K,)``.

    Sample i lies at ``i * SAMPLE_M``; the last one lies at or before the end of the path.
    """
    s_m = np.arange(0.0, path.length_m, SAMPLE_M)
    return np.sqrt(lateral_accel_mps2 / np.maximum(curvature_1pm(path, s_m), _LEAST_CURVATURE_1PM))


def with_braking(speeds_mps: Speeds, decel_mps2: float) -> Speeds:
    """The profile of a vehicle that brakes with ``decel_mps2`` to keep to the speeds, sample by sample."""
    reached = speeds_mps.copy()
    for at in range(len(reached) - 2, -1, -1):
        reached[at] = min(reached[at], math.sqrt(reached[at + 1] ** 2 + 2.0 * decel_mps2 * SAMPLE_M))
    return reached


def with_accelerating(speeds_mps: Speeds, first_mps: float, accel_mps2: float) -> Speeds:
    """The profile of a vehicle that begins with ``first_mps`` and gains speed with ``accel_mps2``."""
    reached = speeds_mps.copy()
    reached[0] = min(reached[0], first_mps)
    for at in range(1, len(reached)):
        reached[at] = min(reached[at], math.sqrt(reached[at - 1] ** 2 + 2.0 * accel_mps2 * SAMPLE_M))
    return reached
