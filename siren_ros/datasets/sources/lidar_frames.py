"""Frames of a LiDAR dataset: sweep, labels, pictures and pose of one step."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from siren_ros.datasets.sources.episode_source import EpisodeSource, MountedSensor
from siren_ros.errors import BagError
from siren_ros.interfaces.boxes import from_ground_truth
from siren_ros.interfaces.image_boxes import from_camera_truth
from siren_ros.interfaces.images import from_compressed_image
from siren_ros.interfaces.point_cloud import from_point_cloud
from siren_ros.interfaces.topics import GROUND_TRUTH, ODOMETRY
from siren_ros.interfaces.transforms import from_odometry
from siren_ros.numerics.arrays import Matrix
from siren_ros.recording.bag_reader import damage_refused
from siren_ros.world.camera_truth import CameraTruth
from siren_ros.world.ground_truth import GroundTruth


@dataclass(frozen=True)
class LidarFrame:
    """What was recorded at one step; None or missing where nothing was."""

    step: int
    points: npt.NDArray[np.void] | None
    truth: GroundTruth | None
    jpegs: dict[str, bytes]
    """Pictures by the camera's name."""
    image_truths: dict[str, CameraTruth]
    map_from_base: Matrix | None


def lidar_of(source: EpisodeSource) -> MountedSensor:
    """The LiDAR of a bag that has one; BagError otherwise."""
    if source.lidar is None:
        raise BagError(str(source.path), "an episode recorded with a LiDAR")
    return source.lidar


def lidar_frames(source: EpisodeSource, *, cameras: bool = False, pose: bool = False) -> Iterator[LidarFrame]:
    """The steps of an episode that hold a sweep, labels or pictures, one after the other.

    Args:
        source: The bag.
        cameras: Also the pictures of all cameras and their labels.
        pose: Also the vehicle's pose.

    Raises:
        BagError: The bag is damaged at the place that has been reached.
    """
    lidar = lidar_of(source)
    shown = source.cameras if cameras else ()
    pictures = {camera.topic: camera.name for camera in shown}
    labels = {camera.truth_topic: camera.name for camera in shown if camera.truth_topic}
    wanted = {lidar.topic, GROUND_TRUTH.name, *pictures, *labels, *((ODOMETRY.name,) if pose else ())}
    for step, held in source.messages_by_step(wanted):
        if not held.keys() - {ODOMETRY.name}:
            continue
        with damage_refused(source.path):
            points = from_point_cloud(held[lidar.topic].read()) if lidar.topic in held else None
            truth = from_ground_truth(held[GROUND_TRUTH.name].read()) if GROUND_TRUTH.name in held else None
            jpegs = {pictures[name]: from_compressed_image(held[name].read()) for name in pictures if name in held}
            truths = {labels[name]: from_camera_truth(held[name].read()) for name in labels if name in held}
            odometry = from_odometry(held[ODOMETRY.name].read())[1] if ODOMETRY.name in held else None
        place = None
        if odometry is not None:
            place = matrix_of_pose(odometry.x_m, odometry.y_m, odometry.z_m, odometry.yaw_rad)
        yield LidarFrame(step, points, truth, jpegs, truths, place)


def matrix_of_pose(x_m: float, y_m: float, z_m: float, yaw_rad: float) -> Matrix:
    """Points in the outer frame from points in the frame at a pose, shape ``(4, 4)``."""
    cos, sin = np.cos(yaw_rad), np.sin(yaw_rad)
    return np.array([[cos, -sin, 0.0, x_m], [sin, cos, 0.0, y_m], [0.0, 0.0, 1.0, z_m], [0.0, 0.0, 0.0, 1.0]])
