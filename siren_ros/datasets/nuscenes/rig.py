"""Names and mounts of nuScenes' sensors: its LiDAR frame has x to the right and y ahead."""

from typing import Any, Final

import numpy as np

from siren_ros.datasets.nuscenes.taxonomy import token
from siren_ros.datasets.sources.episode_source import EpisodeSource, MountedCamera
from siren_ros.interfaces.transforms import quaternion_of_matrix
from siren_ros.numerics.arrays import Matrix

LIDAR: Final = "LIDAR_TOP"
NUSCENES_FROM_LIDAR: Final = np.array([[0.0, -1.0, 0, 0], [1.0, 0, 0, 0], [0, 0, 1.0, 0], [0, 0, 0, 1.0]])
"""Points with x to the right and y ahead from points with x ahead and y to the left."""
_SECTORS: Final = (
    (30.0, "CAM_FRONT"),
    (85.0, "CAM_FRONT_{side}"),
    (150.0, "CAM_BACK_{side}"),
    (181.0, "CAM_BACK"),
)
"""Largest angle from straight ahead in degrees, and the channel; nuScenes' own stand at 0, 55, 110 and 180."""


def channels(cameras: tuple[MountedCamera, ...]) -> dict[str, str]:
    """NuScenes' channel of each camera by the camera's name, from where it looks; a second one there is numbered."""
    found: dict[str, str] = {}
    for camera in cameras:
        ahead = camera.base_from_sensor[:3, 2]
        angle_deg = float(np.degrees(np.arctan2(ahead[1], ahead[0])))
        name = next(name for limit, name in _SECTORS if abs(angle_deg) < limit)
        name = name.format(side="LEFT" if angle_deg > 0.0 else "RIGHT")
        number = sum(taken.rstrip("_0123456789") == name for taken in found.values())
        found[camera.name] = name if number == 0 else f"{name}_{number + 1}"
    return found


def rotation_wxyz(matrix: Matrix) -> list[float]:
    """Rotation of a transform as nuScenes writes it."""
    x, y, z, w = quaternion_of_matrix(matrix[:3, :3])
    return [w, x, y, z]


def calibrated_sensors(source: EpisodeSource, episode_id: str) -> list[dict[str, Any]]:
    """The table's rows of one episode."""
    lidar = source.lidar
    mounts: list[tuple[str, Matrix, list[list[float]]]] = []
    if lidar is not None:
        mounts.append((LIDAR, lidar.base_from_sensor @ np.linalg.inv(NUSCENES_FROM_LIDAR), []))
    names = channels(source.cameras)
    mounts += [(names[one.name], one.base_from_sensor, one.model.matrix.tolist()) for one in source.cameras]
    return [
        {
            "token": token("calibrated_sensor", episode_id, channel),
            "sensor_token": token("sensor", channel),
            "translation": mount[:3, 3].tolist(),
            "rotation": rotation_wxyz(mount),
            "camera_intrinsic": intrinsic,
        }
        for channel, mount, intrinsic in mounts
    ]
