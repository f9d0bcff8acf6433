"""Converts frames and odometry: ``tf2_msgs/TFMessage`` and ``nav_msgs/Odometry``."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from siren_ros.base.numerics.arrays import Floats, Matrix
from siren_ros.data.interfaces.cdr import COUNT, STAMPED, CdrWriter, Layout, stamped, text
from siren_ros.data.interfaces.messages import make_message, time_ns_of
from siren_ros.errors import InputError
from siren_ros.simulation.world.carrier import BASE_FRAME, ODOM_FRAME, Odometry

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]
"""A quaternion as x, y, z, w."""


@dataclass(frozen=True)
class Transform:
    """A transform between frames: ``point_in_parent = rotation · point_in_child + translation``."""

    parent: str
    child: str
    translation_m: Vector
    rotation_xyzw: Quaternion


def quaternion_of_yaw(yaw_rad: float) -> Quaternion:
    """Rotation about the vertical axis, counter-clockwise."""
    return 0.0, 0.0, math.sin(yaw_rad / 2.0), math.cos(yaw_rad / 2.0)


def yaw_of_quaternion(quaternion: Quaternion) -> float:
    """Inverse of ``quaternion_of_yaw``, within (−π, π]; roll and pitch are ignored."""
    x, y, z, w = quaternion
    return math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


def quaternion_of_matrix(rotation: Floats) -> Quaternion:
    """Unit quaternion with w ≥ 0 of a rotation matrix of shape ``(3, 3)``."""
    from scipy.spatial.transform import Rotation  # noqa: PLC0415 - this import takes a quarter of a node's loading time

    x, y, z, w = Rotation.from_matrix(rotation).as_quat(canonical=True)
    return float(x), float(y), float(z), float(w)


def matrix_of_quaternion(quaternion: Quaternion) -> Floats:
    """Rotation matrix, shape ``(3, 3)``."""
    from scipy.spatial.transform import Rotation  # noqa: PLC0415 - as above

    matrix: Floats = Rotation.from_quat(quaternion).as_matrix()
    return matrix


def to_vector(vector: Sequence[float]) -> Any:
    """Makes the message ``geometry_msgs/Vector3``."""
    x, y, z = (float(value) for value in vector)
    return make_message("geometry_msgs/msg/Vector3", x=x, y=y, z=z)


def to_quaternion(quaternion: Quaternion) -> Any:
    """Makes the message ``geometry_msgs/Quaternion``."""
    x, y, z, w = (float(value) for value in quaternion)
    return make_message("geometry_msgs/msg/Quaternion", x=x, y=y, z=z, w=w)


def to_pose(position_m: Sequence[float], quaternion: Quaternion) -> Any:
    """Makes the message ``geometry_msgs/Pose``."""
    x, y, z = (float(value) for value in position_m)
    return make_message(
        "geometry_msgs/msg/Pose",
        position=make_message("geometry_msgs/msg/Point", x=x, y=y, z=z),
        orientation=to_quaternion(quaternion),
    )


def from_vector(message: Any) -> Vector:
    """Reads the message that ``to_vector`` makes; reads a ``geometry_msgs/Point`` as well."""
    return float(message.x), float(message.y), float(message.z)


def from_quaternion(message: Any) -> Quaternion:
    """Reads the message that ``to_quaternion`` makes."""
    return float(message.x), float(message.y), float(message.z), float(message.w)


_TRANSFORM: Final = Layout(f"{STAMPED} s 3d 4d")


def to_tf(step: int, transforms: Sequence[Transform]) -> bytes:
    """Transforms that hold at one step, as ``tf2_msgs/TFMessage`` in CDR."""
    writer = CdrWriter()
    writer.put(COUNT, len(transforms))
    for item in transforms:
        places = (*item.translation_m, *item.rotation_xyzw)
        writer.put(_TRANSFORM, *stamped(step, item.parent), text(item.child), *places)
    return writer.cdr()


def from_tf(message: Any) -> tuple[Transform, ...]:
    """Reads the message that ``to_tf`` makes."""
    return tuple(
        Transform(
            parent=str(stamped.header.frame_id),
            child=str(stamped.child_frame_id),
            translation_m=from_vector(stamped.transform.translation),
            rotation_xyzw=from_quaternion(stamped.transform.rotation),
        )
        for stamped in message.transforms
    )


def matrix_of_transform(transform: Transform) -> Matrix:
    """Matrix that converts points in the child to points in the parent, shape ``(4, 4)``."""
    matrix = np.eye(4)
    matrix[:3, :3] = matrix_of_quaternion(transform.rotation_xyzw)
    matrix[:3, 3] = transform.translation_m
    return matrix


def matrix_between(transforms: Sequence[Transform], parent: str, child: str) -> Matrix:
    """Matrix that converts points in ``child`` to points in ``parent`` through the frames between them, ``(4, 4)``.

    Raises InputError where the transforms do not lead from one to the other.
    """
    by_child = {transform.child: transform for transform in transforms}
    matrix, frame = np.eye(4), child
    while frame != parent:
        if frame not in by_child:
            raise InputError("frames", child, f"a frame with a chain of transforms from {parent}")
        transform = by_child.pop(frame)
        matrix, frame = matrix_of_transform(transform) @ matrix, transform.parent
    return matrix


_CONSTRAINED_VARIANCE: Final = 1e-6
"""Variance of z, roll and pitch, (1 mm)² and (1 mrad)². The world is flat, but filters need an invertible matrix."""
_CONSTRAINED: Final[list[float]] = (np.eye(6) * _CONSTRAINED_VARIANCE).ravel().tolist()
_PLANAR: Final = np.ix_([0, 1, 5], [0, 1, 5])
"""Indices of x, y and yaw in a covariance of x, y, z and rotations about x, y, z."""
_PLANAR_PLACES: Final[list[int]] = np.arange(36).reshape(6, 6)[_PLANAR].ravel().tolist()


_ODOMETRY: Final = Layout(f"{STAMPED} s 7d 36d 6d 36d")


def to_odometry(step: int, odometry: Odometry, parent: str = ODOM_FRAME, child: str = BASE_FRAME) -> bytes:
    """``nav_msgs/Odometry`` as CDR: pose and its covariance in ``parent``, velocity and its covariance in ``child``."""
    writer = CdrWriter()
    writer.put(
        _ODOMETRY,
        *stamped(step, parent),
        text(child),
        *(odometry.x_m, odometry.y_m, 0.0, *quaternion_of_yaw(odometry.yaw_rad)),
        *_to_covariance(odometry.pose_covariance),
        *(odometry.forward_mps, odometry.left_mps, 0.0, 0.0, 0.0, odometry.yaw_rate_radps),
        *_to_covariance(odometry.twist_covariance),
    )
    return writer.cdr()


def _to_covariance(planar: Floats) -> list[float]:
    """Expand a covariance of x, y and yaw to the message's 36 elements, row by row."""
    full = _CONSTRAINED.copy()
    for place, value in zip(_PLANAR_PLACES, planar.ravel().tolist(), strict=True):
        full[place] = value
    return full


def from_odometry(message: Any) -> tuple[int, Odometry]:
    """Reads the message that ``to_odometry`` makes: simulated time in nanoseconds, and the odometry."""
    x, y, _ = from_vector(message.pose.pose.position)
    odometry = Odometry(
        x_m=x,
        y_m=y,
        yaw_rad=yaw_of_quaternion(from_quaternion(message.pose.pose.orientation)),
        forward_mps=float(message.twist.twist.linear.x),
        left_mps=float(message.twist.twist.linear.y),
        yaw_rate_radps=float(message.twist.twist.angular.z),
        pose_covariance=np.array(message.pose.covariance, np.float64).reshape(6, 6)[_PLANAR],
        twist_covariance=np.array(message.twist.covariance, np.float64).reshape(6, 6)[_PLANAR],
    )
    return time_ns_of(message.header.stamp), odometry
