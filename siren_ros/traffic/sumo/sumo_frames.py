"""Poses between the ``map`` frame (footprint centre, yaw) and SUMO (front bumper, navigational angle).

SUMO's angle is in degrees, clockwise from north; its position is the middle of the front bumper.
"""

import numpy as np
import numpy.typing as npt

from siren_ros.numerics.arrays import Floats
from siren_ros.numerics.geometry import wrap_angle

Offset = tuple[float, float]
"""The net's ``netOffset``: ``map = sumo − offset``."""


def sumo_from_map(
    x_m: npt.ArrayLike, y_m: npt.ArrayLike, yaw_rad: npt.ArrayLike, length_m: npt.ArrayLike, offset_m: Offset
) -> tuple[Floats, Floats, Floats]:
    """Front bumper's x and y in SUMO's frame and SUMO's angle in degrees (0–360) of centre poses."""
    yaw = np.asarray(yaw_rad, dtype=np.float64)
    half = np.asarray(length_m, dtype=np.float64) / 2.0
    x = np.asarray(x_m, dtype=np.float64) + half * np.cos(yaw) + offset_m[0]
    y = np.asarray(y_m, dtype=np.float64) + half * np.sin(yaw) + offset_m[1]
    return x, y, np.mod(90.0 - np.degrees(yaw), 360.0)


def map_from_sumo(
    x_m: npt.ArrayLike, y_m: npt.ArrayLike, angle_deg: npt.ArrayLike, length_m: npt.ArrayLike, offset_m: Offset
) -> tuple[Floats, Floats, Floats]:
    """Footprint centre's x and y and the yaw in (−π, π] in the ``map`` frame of SUMO's poses."""
    yaw = wrap_angle(np.radians(90.0 - np.asarray(angle_deg, dtype=np.float64)))
    half = np.asarray(length_m, dtype=np.float64) / 2.0
    x = np.asarray(x_m, dtype=np.float64) - half * np.cos(yaw) - offset_m[0]
    y = np.asarray(y_m, dtype=np.float64) - half * np.sin(yaw) - offset_m[1]
    return x, y, yaw
