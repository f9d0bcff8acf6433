"""Frames of two episodes without a bag: the LiDAR is turned, lifted and away from the map's origin."""

from collections.abc import Sequence

import numpy as np
from detection_boxes import truth_boxes

from siren_ros.base.numerics.arrays import Matrix
from siren_ros.scoring.evaluation.detection.frames import EpisodeFrames, Frames, frames_of

LIDAR_YAW_RAD = np.pi / 3.0
LIDAR_M = (100.0, 50.0, 2.0)
CAMERA_FROM_LIDAR = np.array([[0.0, -1.0, 0, 0], [0, 0, -1.0, -0.5], [1.0, 0, 0, -1.5], [0, 0, 0, 1.0]])
"""The front camera is 1.5 m ahead of the LiDAR and 0.5 m below it; its axes are right, down, ahead."""
GLOBAL_M = (1000.0, 2000.0)
STEPS = (0, 2, 10, 12)
"""Of each episode; 0 and 10 are keyframes."""
PICTURED = (True, False, True, True)


def map_from_lidar(frame: int) -> Matrix:
    """The LiDAR of a frame goes on by 1 m along x from frame to frame."""
    cos, sin = np.cos(LIDAR_YAW_RAD), np.sin(LIDAR_YAW_RAD)
    x, y, z = LIDAR_M
    return np.array([[cos, -sin, 0, x + frame], [sin, cos, 0, y], [0, 0, 1.0, z], [0, 0, 0, 1.0]])


def to_map(frame: int, ahead_m: float, left_m: float, up_m: float) -> list[float]:
    """A place as the LiDAR has it, in the map, written out."""
    cos, sin = np.cos(LIDAR_YAW_RAD), np.sin(LIDAR_YAW_RAD)
    x, y, z = LIDAR_M
    return [x + frame + ahead_m * cos - left_m * sin, y + ahead_m * sin + left_m * cos, z + up_m]


def columns_ahead(rows: Sequence[tuple[int, float]]) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Frame, centre, velocity and yaw of boxes that stand at distances ahead of the LiDAR."""
    places = np.array([to_map(frame, ahead, 0.0, -1.0) for frame, ahead in rows]).reshape(-1, 3)
    return np.array([frame for frame, _ in rows], dtype=np.intp), places, np.zeros((len(rows), 2)), np.zeros(len(rows))


def made_frames(camera: bool = True) -> Frames:
    """Four frames of each of two episodes, without labels."""
    nothing = truth_boxes(np.zeros(0, dtype=np.intp), np.zeros((0, 3)), np.zeros((0, 2)), np.zeros(0))
    count = len(STEPS)
    return frames_of(
        [
            EpisodeFrames(
                bag="bag",
                episode_id=f"episode{number}",
                template="S2",
                seed=number,
                step=np.array(STEPS, dtype=np.intp),
                map_from_lidar=np.array([map_from_lidar(count * number + row) for row in range(count)]),
                vehicle_m=np.array([to_map(count * number + row, 0.0, 0.0, 0.0)[:2] for row in range(count)]),
                pictured=np.array(PICTURED),
                lidar_frame="lidar",
                base_from_lidar=np.eye(4),
                camera_from_lidar=CAMERA_FROM_LIDAR if camera else None,
                global_from_map_m=np.array(GLOBAL_M) * (1 + number),
                truth=nothing,
            )
            for number in range(2)
        ]
    )
