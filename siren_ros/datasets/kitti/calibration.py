"""KITTI's calibration files, for one ideal camera."""

from dataclasses import dataclass

import numpy as np

from siren_ros.datasets.kitti.paper_labels import number_text
from siren_ros.errors import InputError
from siren_ros.interfaces.images import CameraIntrinsics
from siren_ros.interfaces.transforms import Transform, matrix_of_quaternion
from siren_ros.numerics.arrays import Matrix


@dataclass(frozen=True)
class KittiCamera:
    """The camera of ``image_2``, and how it stands to the LiDAR."""

    model: CameraIntrinsics
    camera_from_lidar: Matrix
    """Points in the optical frame from points in the ``lidar`` frame, shape ``(4, 4)``."""


def calibration_text(camera: KittiCamera) -> str:
    """A calibration file: the one camera stands for all four, and there is nothing to rectify."""
    projection = np.hstack((camera.model.matrix, np.zeros((3, 1))))
    lines = [f"P{index}: {_row(projection)}" for index in range(4)]
    lines.append(f"R0_rect: {_row(np.eye(3))}")
    lines.append(f"Tr_velo_to_cam: {_row(camera.camera_from_lidar[:3])}")
    lines.append(f"Tr_imu_to_velo: {_row(np.eye(4)[:3])}")
    return "\n".join(lines) + "\n"


def _row(matrix: Matrix) -> str:
    return " ".join(number_text(float(value), 8) for value in matrix.reshape(-1))


def camera_from_lidar(transforms: tuple[Transform, ...], lidar_frame: str, camera_frame: str) -> Matrix:
    """Transform between two sensors that are mounted on the same parent, shape ``(4, 4)``.

    Raises:
        InputError: A frame is not among the transforms, or the two have different parents.
    """
    by_child = {transform.child: transform for transform in transforms}
    for frame in (lidar_frame, camera_frame):
        if frame not in by_child:
            raise InputError("frame", frame, f"one of {', '.join(sorted(by_child))}")
    lidar, camera = by_child[lidar_frame], by_child[camera_frame]
    if lidar.parent != camera.parent:
        raise InputError("frame", camera.parent, f"the parent of {lidar_frame}, {lidar.parent}")
    matrix: Matrix = np.linalg.inv(_matrix(camera)) @ _matrix(lidar)
    return matrix


def _matrix(transform: Transform) -> Matrix:
    """Points in the parent from points in the child."""
    matrix = np.eye(4)
    matrix[:3, :3] = matrix_of_quaternion(transform.rotation_xyzw)
    matrix[:3, 3] = transform.translation_m
    return matrix
