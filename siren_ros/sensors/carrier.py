"""The carrier's own frames and motion, from its state."""

import numpy as np

from siren_ros.interfaces.transforms import (
    BASE_FRAME,
    MAP_FRAME,
    Odometry,
    Transform,
    quaternion_of_matrix,
    quaternion_of_yaw,
)
from siren_ros.sensors.mount import OPTICAL_FROM_BODY, Matrix
from siren_ros.sensors.suite import SensorSuite
from siren_ros.world.actors import ActorStates
from siren_ros.world.errors import EpisodeError


def row_of_carrier(states: ActorStates, carrier_id: int) -> int:
    """Row of the carrier in the states.

    Raises:
        EpisodeError: The carrier is not there: it has left the map.
    """
    row = int(np.searchsorted(states.actor_id, carrier_id))
    if row == len(states) or states.actor_id[row] != carrier_id:
        raise EpisodeError(f"the sensors' carrier, actor {carrier_id}, is not on the map at step {states.step}")
    return row


def map_from_base_transform(states: ActorStates, row: int) -> Transform:
    """``/tf`` of the carrier: ``map`` to ``base_link``."""
    position = (float(states.x_m[row]), float(states.y_m[row]), float(states.z_m[row]))
    return Transform(MAP_FRAME, BASE_FRAME, position, quaternion_of_yaw(float(states.yaw_rad[row])))


def odometry_of(states: ActorStates, row: int) -> Odometry:
    """Pose in ``map`` and velocity in ``base_link`` of the carrier."""
    yaw_rad = float(states.yaw_rad[row])
    vx_mps, vy_mps = float(states.vx_mps[row]), float(states.vy_mps[row])
    cos, sin = float(np.cos(yaw_rad)), float(np.sin(yaw_rad))
    return Odometry(
        x_m=float(states.x_m[row]),
        y_m=float(states.y_m[row]),
        z_m=float(states.z_m[row]),
        yaw_rad=yaw_rad,
        forward_mps=cos * vx_mps + sin * vy_mps,
        left_mps=cos * vy_mps - sin * vx_mps,
        yaw_rate_radps=float(states.yaw_rate_radps[row]),
    )


def optical_frame(camera: str) -> str:
    """Frame id of a camera's images (REP 103: z forward, x right, y down)."""
    return f"{camera}_optical_frame"


def static_transforms(suite: SensorSuite) -> tuple[Transform, ...]:
    """``/tf_static`` of a suite: ``base_link`` to each sensor, and to each camera's optical frame."""
    mounts = [(spec.name, spec.mount) for spec in (*suite.lidars, *suite.cameras)]
    mounts += [(spec.name, spec.mount) for spec in (*suite.gnss, *suite.imus)]
    bodies = [_transform(name, mount.base_from_sensor) for name, mount in mounts]
    body_from_optical = np.eye(4)
    body_from_optical[:3, :3] = OPTICAL_FROM_BODY.T
    optical = [
        _transform(optical_frame(camera.name), camera.mount.base_from_sensor @ body_from_optical)
        for camera in suite.cameras
    ]
    return (*bodies, *optical)


def _transform(child: str, base_from_child: Matrix) -> Transform:
    x_m, y_m, z_m = (float(value) for value in base_from_child[:3, 3])
    return Transform(BASE_FRAME, child, (x_m, y_m, z_m), quaternion_of_matrix(base_from_child[:3, :3]))
