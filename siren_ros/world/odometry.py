"""Odometry of a vehicle at one step: an estimate with its uncertainty."""

from dataclasses import dataclass

from siren_ros.numerics.arrays import Floats


@dataclass(frozen=True, eq=False)
class Odometry:
    """Pose of ``base_link`` in the ``odom`` frame, and velocity in ``base_link``, each with its covariance."""

    x_m: float
    y_m: float
    yaw_rad: float
    forward_mps: float
    left_mps: float
    yaw_rate_radps: float
    pose_covariance: Floats
    """Of x, y and yaw in the ``odom`` frame, shape ``(3, 3)``."""
    twist_covariance: Floats
    """Of the forward and left velocity and the yaw rate, shape ``(3, 3)``."""
