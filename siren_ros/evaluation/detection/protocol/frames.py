"""The frames of all episodes in one row, and the boxes that are to be found in them."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Final

import numpy as np

from siren_ros.datasets.nuscenes.exporter import KEYFRAME_STEPS
from siren_ros.datasets.nuscenes.taxonomy import token
from siren_ros.evaluation.detection.protocol.boxes import TruthBoxes, joined
from siren_ros.numerics.arrays import Flags, Floats, Ids, Matrix, Rows
from siren_ros.numerics.units import STEP_S

RANGE_M: Final = 50.0
"""nuScenes' range for cars (and the paper's)."""


@dataclass(frozen=True)
class EpisodeFrames:
    """The labelled sweeps of one episode; arrays have one row for each frame."""

    bag: str
    episode_id: str
    template: str
    seed: int
    step: Rows
    map_from_lidar: Floats
    """Shape ``(F, 4, 4)``."""
    vehicle_m: Floats
    """Place of the vehicle with the LiDAR, x and y in the ``map`` frame, shape ``(F, 2)``."""
    pictured: Flags
    """Whether the front camera took a picture at that step: only these are frames of the KITTI export."""
    lidar_frame: str
    base_from_lidar: Matrix
    camera_from_lidar: Matrix | None
    """To the front camera's optical frame; None without one."""
    global_from_map_m: Floats
    """What the nuScenes export adds to x and y, shape ``(2,)``."""
    truth: TruthBoxes
    """With frames counted from 0 in this episode."""
    look: str = ""
    """Weather and time of day."""
    suite: str = ""
    """The sensors."""

    def __len__(self) -> int:
        return len(self.step)

    @property
    def keyframe(self) -> Flags:
        """Which frames are keyframes of the nuScenes export, at 2 Hz."""
        flags: Flags = self.step % KEYFRAME_STEPS == 0
        return flags


@dataclass(frozen=True)
class Frames:
    """All frames in the order of the exported datasets: episode by episode, step by step."""

    episodes: tuple[EpisodeFrames, ...]
    scored: Flags = field(default_factory=lambda: np.zeros(0, dtype=np.bool_))
    """Which frames count, shape ``(F,)``."""

    def __len__(self) -> int:
        return int(self.first[-1])

    @cached_property
    def first(self) -> Rows:
        """Number of the first frame of each episode, and the number of all frames, shape ``(E + 1,)``."""
        return np.cumsum([0, *map(len, self.episodes)]).astype(np.intp)

    @cached_property
    def episode(self) -> Rows:
        """Number of the episode of each frame, shape ``(F,)``."""
        return np.repeat(np.arange(len(self.episodes)), [len(one) for one in self.episodes]).astype(np.intp)

    @cached_property
    def step(self) -> Rows:
        """Step of each frame, shape ``(F,)``."""
        return np.concatenate([one.step for one in self.episodes])

    @cached_property
    def keyframe(self) -> Flags:
        """Which frames are keyframes of the nuScenes export, shape ``(F,)``."""
        return np.concatenate([one.keyframe for one in self.episodes])

    @cached_property
    def pictured(self) -> Flags:
        """Which frames have a picture of the front camera, shape ``(F,)``."""
        return np.concatenate([one.pictured for one in self.episodes])

    @cached_property
    def map_from_lidar(self) -> Floats:
        """Shape ``(F, 4, 4)``."""
        return np.concatenate([one.map_from_lidar for one in self.episodes])

    @cached_property
    def vehicle_m(self) -> Floats:
        """Place of the vehicle with the LiDAR, shape ``(F, 2)``."""
        return np.concatenate([one.vehicle_m for one in self.episodes])

    @cached_property
    def global_from_map_m(self) -> Floats:
        """What the nuScenes export adds to x and y, shape ``(F, 2)``."""
        return np.concatenate([np.tile(one.global_from_map_m, (len(one), 1)) for one in self.episodes])

    @cached_property
    def by_token(self) -> dict[str, int]:
        """Frames by their ``sample_token`` in the nuScenes export."""
        found = {}
        for first, one in zip(self.first.tolist(), self.episodes, strict=False):
            for number in np.flatnonzero(one.keyframe).tolist():
                found[token("sample", one.episode_id, int(one.step[number]))] = first + number
        return found

    @cached_property
    def truth(self) -> TruthBoxes:
        """All labelled boxes."""
        parts = [
            replace(one.truth, frame=one.truth.frame + first)
            for one, first in zip(self.episodes, self.first.tolist(), strict=False)
        ]
        return joined(parts)

    def told(self, frame: int) -> str:
        """A frame for an error message: ``S2_L2_seed0_town step 40``."""
        return f"{self.episodes[self.episode[frame]].episode_id} step {self.step[frame]}"


def in_range(frames: Frames, frame: Rows, centre_m: Floats) -> Flags:
    """Which boxes are nearer than 50 m to the vehicle with the LiDAR, shape ``(N,)``."""
    away = centre_m[:, :2] - frames.vehicle_m[frame]
    near: Flags = np.hypot(away[:, 0], away[:, 1]) < RANGE_M
    return near


def velocities_of_annotations(step: Rows, actor_id: Ids, centre_m: Floats) -> Floats:
    """Velocities of labelled boxes as nuscenes-devkit computes them, shape ``(N, 2)``.

    A velocity is the way from the label of the same vehicle 0.5 s before to that 0.5 s after, by the time between
    (``NuScenes.box_velocity``); where one of them is missing, from or to this label; NaN where both are, and over more
    than 3 s (1.5 s with one).

    Args:
        step: Of each box, shape ``(N,)``.
        actor_id: Of each box.
        centre_m: Shape ``(N, 3)``.
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
    """Frames of several episodes, of which all count."""
    every = Frames(tuple(episodes))
    return replace(every, scored=np.ones(len(every), dtype=np.bool_))
