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
from siren_ros.interfaces.topics import GROUND_TRUTH, TF
from siren_ros.interfaces.transforms import from_tf, matrix_between
from siren_ros.numerics.arrays import Matrix
from siren_ros.recording.bag_reader import damage_refused
from siren_ros.world.camera_truth import CameraTruth
from siren_ros.world.frames import BASE_FRAME, MAP_FRAME
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
    """Pose of what carries the LiDAR: a vehicle, or a station at the roadside."""


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
        pose: Also the pose of the vehicle or of the station.

    Raises:
        BagError: The bag is damaged at the place that has been reached.
    """
    lidar = lidar_of(source)
    shown = source.cameras if cameras else ()
    pictures = {camera.topic: camera.name for camera in shown}
    labels = {camera.truth_topic: camera.name for camera in shown if camera.truth_topic}
    wanted = {lidar.topic, GROUND_TRUTH.name, *pictures, *labels, *((TF.name,) if pose else ())}
    for step, held in source.messages_by_step(wanted):
        if not held.keys() - {TF.name}:
            continue
        with damage_refused(source.path):
            points = from_point_cloud(held[lidar.topic].read()) if lidar.topic in held else None
            truth = from_ground_truth(held[GROUND_TRUTH.name].read()) if GROUND_TRUTH.name in held else None
            jpegs = {pictures[name]: from_compressed_image(held[name].read()) for name in pictures if name in held}
            truths = {labels[name]: from_camera_truth(held[name].read()) for name in labels if name in held}
            frames = from_tf(held[TF.name].read()) if TF.name in held else None
            place = None if frames is None else matrix_between(frames, MAP_FRAME, BASE_FRAME)
            if pose and source.station is not None:
                place = source.station
        yield LidarFrame(step, points, truth, jpegs, truths, place)
