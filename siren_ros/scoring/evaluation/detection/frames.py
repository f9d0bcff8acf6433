"""Labelled frames of episodes by nuScenes' protocol, read from the bags."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Final

import numpy as np

from siren_ros.base.numerics.arrays import Codes, Flags, Floats, Ids, Matrix, Rows
from siren_ros.base.numerics.units import STEP_S
from siren_ros.data.datasets.nuscenes import KEYFRAME_STEPS, map_corners, visible_fractions
from siren_ros.data.datasets.nuscenes_tables import token
from siren_ros.data.episode_source import BagSurvey, EpisodeSource, LidarFrame, lidar_of, open_source
from siren_ros.data.interfaces.boxes import from_camera_truth, from_ground_truth
from siren_ros.data.interfaces.conversions import from_actor_states
from siren_ros.data.interfaces.measurements import from_point_cloud, from_tf, matrix_between
from siren_ros.data.interfaces.topics import ACTORS, GROUND_TRUTH, TF
from siren_ros.data.recording.bag_reader import BagMessage, damage_refused
from siren_ros.errors import BagError
from siren_ros.scoring.evaluation.detection.boxes import PARKED, Boxes, TruthBoxes, attributes_of, joined
from siren_ros.sensing.look import look_of
from siren_ros.simulation.scenario.episode import EpisodeIdentity
from siren_ros.simulation.world.actors import FIRST_PARKED_ID, Mode
from siren_ros.simulation.world.carrier import BASE_FRAME, MAP_FRAME, GroundTruth

RANGE_M: Final = 50.0
"""nuScenes' range for cars, which is also the paper's."""


@dataclass(frozen=True)
class EpisodeFrames:
    """The labelled sweeps of one episode; arrays have one row per frame."""

    bag: str
    episode_id: str
    template: str
    seed: int
    step: Rows
    map_from_lidar: Floats
    """Pose of the LiDAR in the map, shape ``(F, 4, 4)``."""
    vehicle_m: Floats
    """Position of the vehicle with the LiDAR, x and y in the ``map`` frame, shape ``(F, 2)``."""
    pictured: Flags
    """Whether the front camera took a picture at that step; the KITTI export has only these frames."""
    lidar_frame: str
    base_from_lidar: Matrix
    camera_from_lidar: Matrix | None
    """Transform from the LiDAR to the front camera's optical frame; None without a front camera."""
    global_from_map_m: Floats
    """Offset that the nuScenes export adds to x and y, shape ``(2,)``."""
    truth: TruthBoxes
    """Labels; frames are counted from 0 in this episode."""
    look: str = ""
    """Look of the episode: weather and time of day."""
    suite: str = ""
    """Sensor suite of the episode."""
    map_name: str = ""
    values: str = ""
    """Parameters that were set instead of drawn."""
    map_sha256: str = ""

    @property
    def identity(self) -> EpisodeIdentity:
        """Values that decide the episode's split."""
        return EpisodeIdentity(self.map_name, self.template, self.seed, self.values, self.map_sha256)

    def __len__(self) -> int:
        return len(self.step)

    @property
    def frame_of_step(self) -> dict[int, int]:
        """Frame number by step."""
        return {step: frame for frame, step in enumerate(self.step.tolist())}

    @property
    def keyframe(self) -> Flags:
        """Which frames are keyframes of the nuScenes export (2 Hz)."""
        flags: Flags = self.step % KEYFRAME_STEPS == 0
        return flags


@dataclass(frozen=True)
class Frames:
    """All frames in the order of the exported datasets: episode by episode, step by step."""

    episodes: tuple[EpisodeFrames, ...]
    scored: Flags = field(default_factory=lambda: np.zeros(0, dtype=np.bool_))
    """Which frames are scored, shape ``(F,)``."""

    def __len__(self) -> int:
        return int(self.first[-1])

    @cached_property
    def first(self) -> Rows:
        """Number of the first frame of each episode, then the total, shape ``(E + 1,)``."""
        return np.cumsum([0, *map(len, self.episodes)]).astype(np.intp)

    @cached_property
    def episode(self) -> Rows:
        """Number of the episode of each frame, shape ``(F,)``."""
        return np.repeat(np.arange(len(self.episodes)), [*map(len, self.episodes)]).astype(np.intp)

    @cached_property
    def step(self) -> Rows:
        """Step of each frame, shape ``(F,)``."""
        return np.concatenate([episode.step for episode in self.episodes])

    @cached_property
    def keyframe(self) -> Flags:
        """Which frames are keyframes of the nuScenes export, shape ``(F,)``."""
        return np.concatenate([episode.keyframe for episode in self.episodes])

    @cached_property
    def pictured(self) -> Flags:
        """Which frames have a picture of the front camera, shape ``(F,)``."""
        return np.concatenate([episode.pictured for episode in self.episodes])

    @cached_property
    def map_from_lidar(self) -> Floats:
        """Pose of the LiDAR in the map, shape ``(F, 4, 4)``."""
        return np.concatenate([episode.map_from_lidar for episode in self.episodes])

    @cached_property
    def vehicle_m(self) -> Floats:
        """Position of the vehicle with the LiDAR, shape ``(F, 2)``."""
        return np.concatenate([episode.vehicle_m for episode in self.episodes])

    @cached_property
    def global_from_map_m(self) -> Floats:
        """Offset that the nuScenes export adds to x and y, shape ``(F, 2)``."""
        return np.concatenate([np.tile(episode.global_from_map_m, (len(episode), 1)) for episode in self.episodes])

    @cached_property
    def by_token(self) -> dict[str, int]:
        """Frame numbers by their ``sample_token`` in the nuScenes export."""
        return {
            token("sample", episode.episode_id, int(episode.step[number])): first + number
            for first, episode in zip(self.first.tolist(), self.episodes, strict=False)
            for number in np.flatnonzero(episode.keyframe).tolist()
        }

    @cached_property
    def truth(self) -> TruthBoxes:
        """All labelled boxes."""
        parts = zip((episode.truth for episode in self.episodes), self.first.tolist(), strict=False)
        return joined([replace(truth, frame=truth.frame + first) for truth, first in parts])

    def distance_m(self, boxes: Boxes) -> Floats:
        """Distance of boxes from the vehicle with the LiDAR, on the ground, shape ``(N,)``."""
        away = boxes.centre_m[:, :2] - self.vehicle_m[boxes.frame]
        return np.hypot(away[:, 0], away[:, 1])

    def name_of(self, frame: int) -> str:
        """Name of a frame for error messages: ``S2_L2_seed0_town step 40``."""
        return f"{self.episodes[self.episode[frame]].episode_id} step {self.step[frame]}"


def velocities_of_annotations(step: Rows, actor_id: Ids, centre_m: Floats) -> Floats:
    """Velocities of labelled boxes as nuscenes-devkit computes them, shape ``(N, 2)``.

    A velocity is the way from the label of the same vehicle 0.5 s before to that 0.5 s after, by the time between
    (``NuScenes.box_velocity``); where one of them is missing, from or to this label; NaN where both are, and over more
    than 3 s (1.5 s with one). Steps and actors have shape ``(N,)``, the centres ``(N, 3)``.
    """
    phase = step % KEYFRAME_STEPS
    order = np.lexsort((step, phase, actor_id))
    same = (np.diff(actor_id[order].astype(np.int64)) == 0) & (np.diff(phase[order]) == 0)
    before, after = np.r_[False, same], np.r_[same, False]
    place = np.arange(len(order))
    first, last = order[place - before], order[place + after]
    time_s = (step[last] - step[first]) * STEP_S
    limit_s = np.where(before & after, 3.0, 1.5)
    known = (before | after) & (time_s <= limit_s + 1e-9)
    way = centre_m[last, :2] - centre_m[first, :2]
    velocity = np.full((len(order), 2), np.nan)
    velocity[order[known]] = way[known] / time_s[known, None]
    return velocity


def frames_of(episodes: Sequence[EpisodeFrames]) -> Frames:
    """Join the frames of several episodes; all of them are scored."""
    frames = Frames(tuple(episodes))
    return replace(frames, scored=np.ones(len(frames), dtype=np.bool_))


_NO_POINTS: Final = np.zeros(0, dtype=[("x", "<f4")])


def read_frames(survey: BagSurvey, episode_id: str) -> EpisodeFrames:
    """Read the labelled sweeps of an episode and their boxes.

    Raises:
        BagError: The bag is damaged, or lacks the vehicle's pose, the map or every sweep.
    """
    steps: list[int] = []
    poses: list[Matrix] = []
    pictured: list[bool] = []
    parts: list[TruthBoxes] = []
    with open_source(Path(survey.readable)) as source:
        lidar, front, described = lidar_of(source), source.front_camera, source.description
        pictures = {camera.topic for camera in source.cameras if camera == front}
        labels = {camera.truth_topic: camera.name for camera in source.cameras if camera.truth_topic}
        topics = {lidar.topic, GROUND_TRUTH.name, TF.name, ACTORS.name, *pictures, *labels}
        for step, held in source.messages_by_step(topics):
            if lidar.topic not in held or GROUND_TRUTH.name not in held:
                continue
            with damage_refused(source.path):
                truth = from_ground_truth(held[GROUND_TRUTH.name].read())
                poses.append(_pose(source, held))
                seen = {name: from_camera_truth(held[topic].read()) for topic, name in labels.items() if topic in held}
                points = _NO_POINTS if seen else from_point_cloud(held[lidar.topic].read())
                visible = visible_fractions(LidarFrame(len(steps), points, truth, {}, seen, None))
                modes = modes_at(truth.actor_id, held.get(ACTORS.name))
                parts.append(_labelled(len(steps), truth, poses[-1] @ lidar.base_from_sensor, visible, modes))
            steps.append(step)
            pictured.append(bool(pictures & held.keys()))
        if not steps:
            raise BagError(str(source.path), "an episode with at least one sweep with its ground truth")
        numbers, places, boxes = np.array(steps, dtype=np.intp), np.array(poses), joined(parts)
        boxes.velocity_mps[:] = velocities_of_annotations(numbers[boxes.frame], boxes.actor_id, boxes.centre_m)
        return EpisodeFrames(
            bag=survey.bag,
            episode_id=episode_id,
            template=described.template,
            seed=described.seed,
            step=numbers,
            map_from_lidar=places @ lidar.base_from_sensor,
            vehicle_m=places[:, :2, 3],
            pictured=np.array(pictured, dtype=np.bool_),
            lidar_frame=truth.frame_id,
            base_from_lidar=lidar.base_from_sensor,
            camera_from_lidar=None if front is None else front.from_lidar(lidar),
            global_from_map_m=-map_corners(source.network)[0],
            truth=boxes,
            look=look_of(described),
            suite=described.sensor_suite,
            map_name=described.map_name,
            values=described.draw,
            map_sha256=described.map_sha256,
        )


def _pose(source: EpisodeSource, held: Mapping[str, BagMessage]) -> Matrix:
    if source.station is not None:
        return source.station
    place = matrix_between(from_tf(held[TF.name].read()), MAP_FRAME, BASE_FRAME) if TF.name in held else None
    if place is None:
        raise BagError(str(source.path), "an episode with the EMV's odometry")
    return place


def _labelled(frame: int, truth: GroundTruth, map_from_lidar: Matrix, visible: Floats, mode: Codes) -> TruthBoxes:
    turn, shift = map_from_lidar[:3, :3], map_from_lidar[:3, 3]
    speeds = np.stack((truth.vx_mps, truth.vy_mps), axis=-1)
    return TruthBoxes(
        frame=np.full(len(truth), frame, dtype=np.intp),
        centre_m=np.stack((truth.x_m, truth.y_m, truth.z_m), axis=-1) @ turn.T + shift,
        size_m=np.stack((truth.length_m, truth.width_m, truth.height_m), axis=-1),
        yaw_rad=truth.yaw_rad + np.arctan2(turn[1, 0], turn[0, 0]),
        velocity_mps=speeds,
        attribute=np.where(truth.actor_id >= FIRST_PARKED_ID, PARKED, attributes_of(speeds, truth.actor_class)).astype(
            np.uint8
        ),
        actor_id=truth.actor_id,
        actor_class=truth.actor_class,
        lidar_points=truth.lidar_points,
        visible=visible,
        mode=mode,
    )


def modes_at(actor_id: Ids, message: BagMessage | None) -> Codes:
    """Modes of some actors at a step; nominal where no state was recorded."""
    modes = np.full(len(actor_id), Mode.NOMINAL, dtype=np.uint8)
    if message is None:
        return modes
    states = from_actor_states(message.read())
    row = np.searchsorted(states.actor_id, actor_id)
    there = (row < len(states)) & (states.actor_id[np.minimum(row, len(states) - 1)] == actor_id)
    modes[there] = states.mode[row[there]]
    return modes
