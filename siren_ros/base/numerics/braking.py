"""Braking formulas: distances, decelerations and safe speeds of vehicles, and speeds in bends.

The formulas take squares of speeds: ``v * v`` and ``v**2`` differ in the last bit, and records keep theirs.
"""

import math
from typing import Final, TypeVar

import numpy as np
import numpy.typing as npt

from siren_ros.base.numerics.compiled import compiled
from siren_ros.base.numerics.geometry import Polyline, wrap_angle

SAMPLE_M: Final = 1.0
"""Distance between the samples of a speed profile."""
_HALF_WINDOW_M: Final = 2.0
"""Half of the length over which the change of heading gives the curvature; the length is less than a bus's wheelbase. A
corner of the polyline counts as a bend of this length."""
_LEAST_CURVATURE_1PM: Final = 1e-6
_CORNER_RAD: Final = 0.1
"""Change of heading within a metre from which a path has a corner: rounded ones have a point for each 0.05 rad."""

Speeds = npt.NDArray[np.float64]
Number = TypeVar("Number", float, Speeds)


def braking_distance_m(speed_sq: Number, brake_mps2: float) -> Number:
    """Braking distance ``v² / 2b`` from the square of the speed in m²/s²."""
    return speed_sq / (2.0 * brake_mps2)


def needed_brake_mps2(speed_sq: Number, way_m: Number) -> Number:
    """Constant deceleration ``v² / 2s`` that stops a vehicle within a distance.

    The speed is given as its square in m²/s².
    """
    return speed_sq / (2.0 * way_m)


def stops_within(speed_sq: float, brake_mps2: float, way_m: float) -> bool:
    """Whether a vehicle stops within a distance, ``v² < 2bs``, from the square of its speed in m²/s²."""
    return speed_sq < 2.0 * brake_mps2 * way_m


def speed_before_mps(slower_sq: float, brake_mps2: float, way_m: float) -> float:
    """Speed ``sqrt(v² + 2bs)`` from which braking over a distance reaches a lower speed.

    The lower speed is given as its square in m²/s².
    """
    return math.sqrt(slower_sq + 2.0 * brake_mps2 * way_m)


@compiled
def safe_following_mps(lead_mps: float, free_m: float, brake_mps2: float, reaction_s: float) -> float:
    """Krauss's safe speed (1998) behind another vehicle: ``−bτ + sqrt((bτ)² + v_l² + 2b·gap)``.

    The gap is ``free_m``: the free way to that vehicle, less the gap that is kept at standstill.
    """
    keeps = brake_mps2 * reaction_s
    return math.sqrt(keeps**2 + lead_mps * lead_mps + 2.0 * brake_mps2 * free_m) - keeps


def curvature_1pm(path: Polyline, s_m: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Unsigned curvature of a path at arc lengths, shape of ``s_m``; before and behind the path it goes straight on."""
    turned = wrap_angle(path.heading_rad(s_m + _HALF_WINDOW_M) - path.heading_rad(s_m - _HALF_WINDOW_M))
    return np.abs(turned) / (2.0 * _HALF_WINDOW_M)


def bend_speeds_mps(path: Polyline, lateral_accel_mps2: float) -> Speeds:
    """Speed at which each metre of a path causes a lateral acceleration: ``sqrt(a / curvature)``, shape ``(K,)``.

    Sample i lies at ``i * SAMPLE_M``; the last one lies at or before the end of the path. Corners count with half of
    their own curvature, too: the centre of a body with both ends on the path turns by half when its front passes one.
    """
    s_m = np.arange(0.0, path.length_m, SAMPLE_M)
    return np.sqrt(lateral_accel_mps2 / np.maximum(curvature_1pm(path, s_m), _corners_1pm(path, len(s_m))))


def _corners_1pm(path: Polyline, samples: int) -> Speeds:
    """Half of the curvature at the corners near each sample, by chords of ``SAMPLE_M``; least where there is none."""
    way = np.diff(path.at(0.5 * SAMPLE_M * np.arange(2 * samples)).reshape(-1, 2), axis=0)
    heading = np.unwrap(np.arctan2(*(way[1:] + way[:-1]).T[::-1]))
    turned = np.abs(heading[2:] - heading[:-2])
    near = np.max([np.pad(turned, (2 + shift, 4 - shift))[: 2 * samples : 2] for shift in (-1, 0, 1)], axis=0)
    return np.where(near > _CORNER_RAD, 0.5 * near / SAMPLE_M, _LEAST_CURVATURE_1PM)


def with_braking(speeds_mps: Speeds, decel_mps2: float) -> Speeds:
    """Lower the speeds so that a vehicle with deceleration ``decel_mps2`` can keep to them, sample by sample."""
    reached = speeds_mps.tolist()  # Python's own numbers are faster in a loop
    for at in range(len(reached) - 2, -1, -1):
        reached[at] = min(reached[at], speed_before_mps(reached[at + 1] ** 2, decel_mps2, SAMPLE_M))
    return np.array(reached)


def squares_with_braking(squares: Speeds, brake_mps2: float, spacing_m: float) -> Speeds:
    """As ``with_braking``, for squares of speeds (m²/s²) at places ``spacing_m`` apart, as one array operation."""
    braking = 2.0 * brake_mps2 * spacing_m * np.arange(len(squares))
    return np.asarray(np.minimum.accumulate((squares + braking)[::-1])[::-1] - braking)


def with_accelerating(speeds_mps: Speeds, first_mps: float, accel_mps2: float) -> Speeds:
    """Lower the speeds to those of a vehicle that starts with ``first_mps`` and accelerates with ``accel_mps2``."""
    reached = speeds_mps.copy()
    reached[0] = min(reached[0], first_mps)
    for at in range(1, len(reached)):
        reached[at] = min(reached[at], speed_before_mps(reached[at - 1] ** 2, accel_mps2, SAMPLE_M))
    return reached
