"""Where a sensor sits on its carrier, and rigid transforms as 4 × 4 matrices."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from siren_ros.numerics.arrays import Matrix


def rotation_from_rpy(roll_rad: float, pitch_rad: float, yaw_rad: float) -> Matrix:
    """Rotation about x, then y, then z of the fixed axes (REP 103's roll, pitch, yaw), shape ``(3, 3)``."""
    cr, sr = np.cos(roll_rad), np.sin(roll_rad)
    cp, sp = np.cos(pitch_rad), np.sin(pitch_rad)
    cy, sy = np.cos(yaw_rad), np.sin(yaw_rad)
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def transform(rotation: Matrix, translation_m: npt.ArrayLike) -> Matrix:
    """Rigid transform ``[R t; 0 1]``, shape ``(4, 4)``."""
    matrix = np.eye(4)
    matrix[:3, :3] = rotation
    matrix[:3, 3] = translation_m
    return matrix


def map_from_base(x_m: float, y_m: float, z_m: float, yaw_rad: float) -> Matrix:
    """Transform that takes coordinates in an actor's ``base_link`` to the ``map`` frame, shape ``(4, 4)``."""
    return transform(rotation_from_rpy(0.0, 0.0, yaw_rad), (x_m, y_m, z_m))


def inverse(matrix: Matrix) -> Matrix:
    """Inverse of a rigid transform, shape ``(4, 4)``."""
    rotation = matrix[:3, :3].T
    return transform(rotation, -rotation @ matrix[:3, 3])


@dataclass(frozen=True)
class Mount:
    """A sensor's place in its carrier's ``base_link``: x forward, y left, z up, yaw counter-clockwise.

    A CARLA mount (y right, yaw clockwise, pitch up) becomes one of these by negating y, yaw and pitch; the
    origins agree, because CARLA's vehicle origin too is the footprint's centre on the ground.
    """

    x_m: float
    y_m: float
    z_m: float
    yaw_rad: float = 0.0
    pitch_rad: float = 0.0
    """Positive looks down (REP 103)."""
    roll_rad: float = 0.0

    @property
    def base_from_sensor(self) -> Matrix:
        """Transform that takes sensor coordinates to ``base_link``, shape ``(4, 4)``."""
        rotation = rotation_from_rpy(self.roll_rad, self.pitch_rad, self.yaw_rad)
        return transform(rotation, (self.x_m, self.y_m, self.z_m))


OPTICAL_FROM_BODY = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])
"""Rotation from a camera's body frame (x forward, y left, z up) to its optical frame (z forward, x right, y down)."""
OPTICAL_FROM_BODY.setflags(write=False)
