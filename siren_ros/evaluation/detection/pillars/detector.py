"""The learned detector on sweeps: pillars in, boxes out."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt

from siren_ros.datasets.sources.episode_source import open_source
from siren_ros.datasets.sources.lidar_frames import lidar_frames, lidar_of
from siren_ros.evaluation.detection.pillars.grid import SENSOR_HEIGHT_M, SHIPPED_DETECTOR
from siren_ros.evaluation.detection.pillars.network_file import DetectorNetwork, load_detector
from siren_ros.evaluation.detection.pillars.pillars import pillars_of
from siren_ros.evaluation.detection.pillars.sweeps import SweepMemory
from siren_ros.evaluation.detection.protocol.boxes import FoundBoxes, attributes_of, joined
from siren_ros.evaluation.detection.protocol.frames import EpisodeFrames
from siren_ros.numerics.arrays import Flags, Floats, Matrix
from siren_ros.params.resources import params_dir

SHIPPED: Final = Path("detectors", "pillars.onnx")
"""Place of the weights below the parameter files."""
_LEAST_SCORE: Final = 0.03
_APART_M: Final = 1.8
"""Centres of two vehicles are farther apart than this, the width of a car."""


def detector_file(name: str) -> Path:
    """The ONNX file of a detector that a user names: ``pillars``, which ships, or a path."""
    return params_dir() / SHIPPED if name == SHIPPED_DETECTOR else Path(name)


@dataclass(frozen=True)
class SweepBoxes:
    """What was found in one sweep, in the LiDAR's frame."""

    centre_m: Floats
    """Shape ``(N, 3)``."""
    size_m: Floats
    """Length, width, height, shape ``(N, 3)``."""
    yaw_rad: Floats
    velocity_mps: Floats
    """Over ground, in the axes of the LiDAR's frame, shape ``(N, 2)``."""
    score: Floats
    label: npt.NDArray[np.str_]

    def __len__(self) -> int:
        return len(self.score)


@dataclass
class PillarDetector:
    """Finds vehicles in the sweeps of one LiDAR, each with those before it."""

    network: DetectorNetwork
    height_m: float = SENSOR_HEIGHT_M
    """Of the LiDAR above the ground."""
    memory: SweepMemory = field(init=False)

    def __post_init__(self) -> None:
        self.memory = SweepMemory(self.network.grid.sweeps)

    def add(self, step: int, points: npt.NDArray[np.void], map_from_lidar: Matrix) -> None:
        """Takes the sweep of a step; see ``SweepMemory.add``."""
        self.memory.add(step, points, map_from_lidar)

    def boxes(self) -> SweepBoxes:
        """Vehicles in the newest sweep."""
        grid, names = self.network.grid, np.array(self.network.class_names)
        points, lift_m = self.memory.points(), self.height_m - SENSOR_HEIGHT_M
        points[:, 2] += np.float32(lift_m)
        table, score, share = self.network.run(pillars_of(points, grid))
        table[:, 2] -= lift_m
        kept = (score >= _LEAST_SCORE) & np.isfinite(table).all(axis=1)
        kept[kept] = apart(table[kept, :2], score[kept], _APART_M)
        table = table[kept]
        return SweepBoxes(
            centre_m=table[:, :3],
            size_m=table[:, 3:6],
            yaw_rad=np.arctan2(table[:, 6], table[:, 7]),
            velocity_mps=table[:, 8:10],
            score=score[kept],
            label=names[share[kept].argmax(axis=1)],
        )


def apart(centre_m: Floats, score: Floats, least_m: float) -> Flags:
    """Which boxes stay: those that no box with a higher score is nearer to (CenterPoint's circle NMS)."""
    order = np.argsort(-score, kind="stable")
    stays: Flags = np.zeros(len(score), dtype=np.bool_)
    for row in order:
        away = centre_m[stays] - centre_m[row]
        stays[row] = not (np.hypot(away[:, 0], away[:, 1]) < least_m).any()
    return stays


def detect_pillars(episode: EpisodeFrames, weights: Path | None = None) -> FoundBoxes:
    """Vehicles in all labelled sweeps of an episode, in the ``map`` frame.

    Args:
        episode: Its frames.
        weights: An ONNX file with its card; None for those that ship.

    Raises:
        InputError: The weights cannot be used.
        BagError: The bag is damaged.
    """
    network = load_detector(weights or detector_file(SHIPPED_DETECTOR))
    frame_of_step = {step: frame for frame, step in enumerate(episode.step.tolist())}
    parts: list[FoundBoxes] = []
    with open_source(Path(episode.bag)) as source:
        base_from_lidar = lidar_of(source).base_from_sensor
        detector = PillarDetector(network, float(base_from_lidar[2, 3]))
        for frame in lidar_frames(source, pose=True):
            if frame.points is None or frame.map_from_base is None:
                continue
            map_from_lidar = frame.map_from_base @ base_from_lidar
            detector.add(frame.step, frame.points, map_from_lidar)
            if frame.step in frame_of_step:
                parts.append(_in_map(frame_of_step[frame.step], detector.boxes(), map_from_lidar))
    return _joined(parts)


def _in_map(frame: int, found: SweepBoxes, map_from_lidar: Matrix) -> FoundBoxes:
    turn, shift = map_from_lidar[:3, :3], map_from_lidar[:3, 3]
    velocity = found.velocity_mps @ turn[:2, :2].T
    return FoundBoxes(
        frame=np.full(len(found), frame, dtype=np.intp),
        centre_m=found.centre_m @ turn.T + shift,
        size_m=found.size_m,
        yaw_rad=found.yaw_rad + np.arctan2(turn[1, 0], turn[0, 0]),
        velocity_mps=velocity,
        attribute=attributes_of(velocity),
        score=found.score,
        label=found.label,
    )


def no_boxes() -> SweepBoxes:
    """What is found where there is no sweep."""
    return SweepBoxes(
        centre_m=np.zeros((0, 3)),
        size_m=np.zeros((0, 3)),
        yaw_rad=np.zeros(0),
        velocity_mps=np.zeros((0, 2)),
        score=np.zeros(0),
        label=np.zeros(0, dtype=np.str_),
    )


def _joined(parts: list[FoundBoxes]) -> FoundBoxes:
    return joined([*parts, _in_map(0, no_boxes(), np.eye(4))])
