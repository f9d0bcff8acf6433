"""Frames and odometry: ``tf2_msgs/TFMessage`` and ``nav_msgs/Odometry``."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from siren_ros.interfaces.messages import header, make_message, time_ns_of
from siren_ros.numerics.units import time_ns_of_step
from siren_ros.world.frames import BASE_FRAME, MAP_FRAME

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]
"""x, y, z, w."""


@dataclass(frozen=True)
class Transform:
    """``point_in_parent = rotation · point_in_child + translation``."""

    parent: str
    child: str
    translation_m: Vector
    rotation_xyzw: Quaternion


@dataclass(frozen=True)
class Odometry:
    """Pose of a vehicle in the ``map`` frame and its velocity in its own axes (x forward, y left)."""

    x_m: float
    y_m: float
    z_m: float
    yaw_rad: float
    forward_mps: float
    left_mps: float
    yaw_rate_radps: float


def quaternion_of_yaw(yaw_rad: float) -> Quaternion:
    """Rotation about the vertical axis, counter-clockwise."""
    return 0.0, 0.0, math.sin(yaw_rad / 2.0), math.cos(yaw_rad / 2.0)


def yaw_of_quaternion(quaternion: Quaternion) -> float:
    """Inverse of ``quaternion_of_yaw``, within (−π, π]; roll and pitch are ignored."""
    x, y, z, w = quaternion
    return math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


def quaternion_of_matrix(rotation: npt.NDArray[np.float64]) -> Quaternion:
    """Unit quaternion with w ≥ 0 of a rotation matrix of shape ``(3, 3)``."""
    x, y, z, w = Rotation.from_matrix(rotation).as_quat(canonical=True)
    return float(x), float(y), float(z), float(w)


def matrix_of_quaternion(quaternion: Quaternion) -> npt.NDArray[np.float64]:
    """Rotation matrix, shape ``(3, 3)``."""
    matrix: npt.NDArray[np.float64] = Rotation.from_quat(quaternion).as_matrix()
    return matrix


def to_vector(vector: Sequence[float]) -> Any:
    """``geometry_msgs/Vector3``."""
    x, y, z = (float(value) for value in vector)
    return make_message("geometry_msgs/msg/Vector3", x=x, y=y, z=z)


def to_quaternion(quaternion: Quaternion) -> Any:
    """``geometry_msgs/Quaternion``."""
    x, y, z, w = (float(value) for value in quaternion)
    return make_message("geometry_msgs/msg/Quaternion", x=x, y=y, z=z, w=w)


def to_pose(position_m: Sequence[float], quaternion: Quaternion) -> Any:
    """``geometry_msgs/Pose``."""
    x, y, z = (float(value) for value in position_m)
    return make_message(
        "geometry_msgs/msg/Pose",
        position=make_message("geometry_msgs/msg/Point", x=x, y=y, z=z),
        orientation=to_quaternion(quaternion),
    )


def from_vector(message: Any) -> Vector:
    """Inverse of ``to_vector``; reads a ``geometry_msgs/Point`` as well."""
    return float(message.x), float(message.y), float(message.z)


def from_quaternion(message: Any) -> Quaternion:
    """Inverse of ``to_quaternion``."""
    return float(message.x), float(message.y), float(message.z), float(message.w)


def to_tf(step: int, transforms: Sequence[Transform]) -> Any:
    """``tf2_msgs/TFMessage`` of transforms that hold at one step."""
    return make_message(
        "tf2_msgs/msg/TFMessage",
        transforms=[
            make_message(
                "geometry_msgs/msg/TransformStamped",
                header=header(time_ns_of_step(step), transform.parent),
                child_frame_id=transform.child,
                transform=make_message(
                    "geometry_msgs/msg/Transform",
                    translation=to_vector(transform.translation_m),
                    rotation=to_quaternion(transform.rotation_xyzw),
                ),
            )
            for transform in transforms
        ],
    )


def from_tf(message: Any) -> tuple[Transform, ...]:
    """Inverse of ``to_tf``."""
    return tuple(
        Transform(
            parent=str(stamped.header.frame_id),
            child=str(stamped.child_frame_id),
            translation_m=from_vector(stamped.transform.translation),
            rotation_xyzw=from_quaternion(stamped.transform.rotation),
        )
        for stamped in message.transforms
    )


def to_odometry(step: int, odometry: Odometry, child: str = BASE_FRAME) -> Any:
    """``nav_msgs/Odometry`` without uncertainty: it is the simulation's own state."""
    twist = make_message(
        "geometry_msgs/msg/Twist",
        linear=to_vector((odometry.forward_mps, odometry.left_mps, 0.0)),
        angular=to_vector((0.0, 0.0, odometry.yaw_rate_radps)),
    )
    pose = to_pose((odometry.x_m, odometry.y_m, odometry.z_m), quaternion_of_yaw(odometry.yaw_rad))
    return make_message(
        "nav_msgs/msg/Odometry",
        header=header(time_ns_of_step(step), MAP_FRAME),
        child_frame_id=child,
        pose=make_message("geometry_msgs/msg/PoseWithCovariance", pose=pose, covariance=np.zeros(36)),
        twist=make_message("geometry_msgs/msg/TwistWithCovariance", twist=twist, covariance=np.zeros(36)),
    )


def from_odometry(message: Any) -> tuple[int, Odometry]:
    """Inverse of ``to_odometry``: simulated time in nanoseconds and the state."""
    x, y, z = from_vector(message.pose.pose.position)
    odometry = Odometry(
        x_m=x,
        y_m=y,
        z_m=z,
        yaw_rad=yaw_of_quaternion(from_quaternion(message.pose.pose.orientation)),
        forward_mps=float(message.twist.twist.linear.x),
        left_mps=float(message.twist.twist.linear.y),
        yaw_rate_radps=float(message.twist.twist.angular.z),
    )
    return time_ns_of(message.header.stamp), odometry
