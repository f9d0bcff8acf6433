"""Frames and labels out of a bag, one step in memory at a time."""

from collections.abc import Mapping
from pathlib import Path
from typing import Final

import numpy as np

from siren_ros.datasets.exporting.survey import BagSurvey
from siren_ros.datasets.nuscenes.exporter import visible_fractions
from siren_ros.datasets.nuscenes.map_mask import map_corners
from siren_ros.datasets.sources.episode_source import EpisodeSource, MountedSensor, open_source
from siren_ros.datasets.sources.lidar_frames import LidarFrame, lidar_of
from siren_ros.errors import BagError
from siren_ros.evaluation.detection.protocol.boxes import TruthBoxes, attributes_of, joined
from siren_ros.evaluation.detection.protocol.frames import EpisodeFrames, velocities_of_annotations
from siren_ros.interfaces.boxes import from_ground_truth
from siren_ros.interfaces.conversions import from_actor_states
from siren_ros.interfaces.image_boxes import from_camera_truth
from siren_ros.interfaces.point_cloud import from_point_cloud
from siren_ros.interfaces.topics import ACTORS, GROUND_TRUTH, TF
from siren_ros.interfaces.transforms import from_tf, matrix_between
from siren_ros.numerics.arrays import Codes, Floats, Ids, Matrix
from siren_ros.recording.bag_reader import BagMessage, damage_refused
from siren_ros.sensors.suite.look_file import look_of
from siren_ros.world.actors import Mode
from siren_ros.world.frames import BASE_FRAME, MAP_FRAME
from siren_ros.world.ground_truth import GroundTruth

_NO_POINTS: Final = np.zeros(0, dtype=[("x", "<f4")])
_EMPTY: Final = TruthBoxes(
    frame=np.zeros(0, dtype=np.intp),
    centre_m=np.zeros((0, 3)),
    size_m=np.zeros((0, 3)),
    yaw_rad=np.zeros(0),
    velocity_mps=np.zeros((0, 2)),
    attribute=np.zeros(0, dtype=np.uint8),
    actor_id=np.zeros(0, dtype=np.uint32),
    actor_class=np.zeros(0, dtype=np.uint8),
    lidar_points=np.zeros(0, dtype=np.uint32),
    visible=np.zeros(0),
    mode=np.zeros(0, dtype=np.uint8),
)


def read_frames(survey: BagSurvey, episode_id: str) -> EpisodeFrames:
    """The labelled sweeps of an episode and their boxes.

    Raises:
        BagError: The bag is damaged, or lacks the vehicle's pose, the map or every sweep.
    """
    with open_source(Path(survey.readable)) as source:
        return _Reading(source).frames(survey.bag, episode_id)


class _Reading:
    def __init__(self, source: EpisodeSource) -> None:
        self._source = source
        self._lidar: MountedSensor = lidar_of(source)
        self._pictures = {camera.topic for camera in source.cameras if camera == source.front_camera}
        self._lidar_frame = ""
        self._labels = {camera.truth_topic: camera.name for camera in source.cameras if camera.truth_topic}

    def frames(self, bag: str, episode_id: str) -> EpisodeFrames:
        source, parts = self._source, [_EMPTY]
        steps: list[int] = []
        poses: list[Matrix] = []
        pictured: list[bool] = []
        wanted = {self._lidar.topic, GROUND_TRUTH.name, TF.name, ACTORS.name, *self._pictures, *self._labels}
        for step, held in source.messages_by_step(wanted):
            if self._lidar.topic not in held or GROUND_TRUTH.name not in held:
                continue
            with damage_refused(source.path):
                truth = from_ground_truth(held[GROUND_TRUTH.name].read())
                poses.append(self._pose(held))
                parts.append(self._boxes(len(steps), truth, poses[-1] @ self._lidar.base_from_sensor, held))
            steps.append(step)
            pictured.append(bool(self._pictures & held.keys()))
        if not steps:
            raise BagError(str(source.path), "an episode with at least one sweep with its ground truth")
        numbers = np.array(steps, dtype=np.intp)
        boxes = joined(parts)
        boxes.velocity_mps[:] = velocities_of_annotations(numbers[boxes.frame], boxes.actor_id, boxes.centre_m)
        places = np.array(poses)
        front = source.front_camera
        return EpisodeFrames(
            bag=bag,
            episode_id=episode_id,
            template=source.description.template,
            seed=source.description.seed,
            step=numbers,
            map_from_lidar=places @ self._lidar.base_from_sensor,
            vehicle_m=places[:, :2, 3],
            pictured=np.array(pictured, dtype=np.bool_),
            lidar_frame=self._lidar_frame,
            base_from_lidar=self._lidar.base_from_sensor,
            camera_from_lidar=None if front is None else front.from_lidar(self._lidar),
            global_from_map_m=-map_corners(source.network)[0],
            truth=boxes,
            look=look_of(source.description),
            suite=source.description.sensor_suite,
        )

    def _pose(self, held: Mapping[str, BagMessage]) -> Matrix:
        if self._source.station is not None:
            return self._source.station
        place = matrix_between(from_tf(held[TF.name].read()), MAP_FRAME, BASE_FRAME) if TF.name in held else None
        if place is None:
            raise BagError(str(self._source.path), "an episode with the EMV's odometry")
        return place

    def _boxes(
        self, frame: int, truth: GroundTruth, map_from_lidar: Matrix, held: Mapping[str, BagMessage]
    ) -> TruthBoxes:
        self._lidar_frame = truth.frame_id
        turn, shift = map_from_lidar[:3, :3], map_from_lidar[:3, 3]
        speeds = np.stack((truth.vx_mps, truth.vy_mps), axis=-1)
        return TruthBoxes(
            frame=np.full(len(truth), frame, dtype=np.intp),
            centre_m=np.stack((truth.x_m, truth.y_m, truth.z_m), axis=-1) @ turn.T + shift,
            size_m=np.stack((truth.length_m, truth.width_m, truth.height_m), axis=-1),
            yaw_rad=truth.yaw_rad + np.arctan2(turn[1, 0], turn[0, 0]),
            velocity_mps=speeds,
            attribute=attributes_of(speeds),
            actor_id=truth.actor_id,
            actor_class=truth.actor_class,
            lidar_points=truth.lidar_points,
            visible=self._visible(frame, truth, held),
            mode=_modes(truth.actor_id, held.get(ACTORS.name)),
        )

    def _visible(self, frame: int, truth: GroundTruth, held: Mapping[str, BagMessage]) -> Floats:
        seen = {name: from_camera_truth(held[topic].read()) for topic, name in self._labels.items() if topic in held}
        points = _NO_POINTS if seen else from_point_cloud(held[self._lidar.topic].read())
        return visible_fractions(LidarFrame(frame, points, truth, {}, seen, None))


def _modes(actor_id: Ids, message: BagMessage | None) -> Codes:
    """Modes of some actors at a step; nominal for one without a recorded state."""
    modes = np.full(len(actor_id), Mode.NOMINAL, dtype=np.uint8)
    if message is None:
        return modes
    states = from_actor_states(message.read())
    row = np.searchsorted(states.actor_id, actor_id)
    there = (row < len(states)) & (states.actor_id[np.minimum(row, len(states) - 1)] == actor_id)
    modes[there] = states.mode[row[there]]
    return modes
