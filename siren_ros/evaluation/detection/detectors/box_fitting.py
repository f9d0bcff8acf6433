"""A vehicle's box around some of its returns."""

from dataclasses import dataclass
from typing import Final

import numpy as np

from siren_ros.numerics.arrays import Floats

_TURNS: Final = np.radians(np.arange(0.0, 90.0, 1.0))
_NEAREST_M: Final = 0.05
"""Distances to the edge below this count alike."""
_WIDEST_REAR_M: Final = 2.3
_TYPICAL_M: Final = (4.5, 1.9, 1.55)
"""Length, width, height that a box has at least: a LiDAR sees one or two sides of a vehicle."""


@dataclass(frozen=True)
class FittedBox:
    """In the frame of the points."""

    centre_m: Floats
    """Shape ``(3,)``."""
    size_m: Floats
    """Length, width, height."""
    yaw_rad: float
    """Of the longer side; its direction is not known, so within a quarter turn of x."""
    seen_m: Floats
    """Length and width of the part that was seen."""


def fit_box(points: Floats, ground_m: float) -> FittedBox:
    """The rectangle whose edges lie closest to the points, made as large as a car away from the sensor.

    Source of the criterion: X. Zhang, W. Xu, C. Dong, J. Dolan, "Efficient L-shape fitting for vehicle detection using
    laser scanners", IV 2017, "closeness".

    Args:
        points: Returns of one vehicle, shape ``(N, 3)``, in a frame with the sensor at the origin.
        ground_m: Height of the ground below them.
    """
    cos, sin = np.cos(_TURNS)[:, None], np.sin(_TURNS)[:, None]
    along = cos * points[:, 0] + sin * points[:, 1]
    across = -sin * points[:, 0] + cos * points[:, 1]
    edges = [np.minimum(side.max(axis=1)[:, None] - side, side - side.min(axis=1)[:, None]) for side in (along, across)]
    best = int((1.0 / np.maximum(np.minimum(*edges), _NEAREST_M)).sum(axis=1).argmax())
    low = np.array([along[best].min(), across[best].min()])
    high = np.array([along[best].max(), across[best].max()])
    yaw, seen = float(_TURNS[best]), high - low
    # A side that is no longer than a car is wide is taken for its front or rear.
    along_first = (seen[0] >= seen[1]) != (seen.max() < _WIDEST_REAR_M)
    wanted = np.array(_TYPICAL_M[:2]) if along_first else np.array(_TYPICAL_M[1::-1])
    grown = np.maximum(seen, wanted)
    # The side that faces the sensor was seen; what is missing lies behind it.
    middle = np.where(low + high >= 0.0, low + grown / 2.0, high - grown / 2.0)
    if grown[1] > grown[0]:
        grown, seen, yaw, middle = grown[::-1], seen[::-1], yaw + np.pi / 2.0, np.array([middle[1], -middle[0]])
    height = max(float(points[:, 2].max()) - ground_m, _TYPICAL_M[2])
    turn = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
    centre = np.array([*(turn @ middle), ground_m + height / 2.0])
    yaw = float(np.arctan(np.tan(yaw)))
    return FittedBox(centre, np.array([*grown, height]), yaw, seen)
