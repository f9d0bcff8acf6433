"""The project's learned detector: loads the network, stores past sweeps, and turns the network's output into boxes."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from siren_ros.base.numerics.arrays import Flags, Floats, Floats32, Matrix
from siren_ros.base.numerics.units import STEP_S
from siren_ros.base.params.network_file import open_network
from siren_ros.base.params.resources import params_dir
from siren_ros.data.record.episode_source import lidar_frames, lidar_of, open_source
from siren_ros.errors import InputError
from siren_ros.scoring.evaluation.detection.boxes import FoundBoxes, attributes_of, joined
from siren_ros.scoring.evaluation.detection.detectors.pillars import (
    FEATURES,
    SENSOR_HEIGHT_M,
    PillarGrid,
    Pillars,
    pillars_of,
)
from siren_ros.scoring.evaluation.detection.frames import EpisodeFrames
from siren_ros.scoring.evaluation.detection.tracker import Tracker
from siren_ros.simulation.scenario.episode import SHIPPED_DETECTOR
from siren_ros.simulation.scenario.splits import SeenEpisodes

FORM_VERSION: Final = 1
"""Version of the network's inputs and outputs; files of another version are refused."""
INPUTS: Final = ("points", "cell")
OUTPUTS: Final = ("box", "score", "class_share")
BOX_COLUMNS: Final = ("x", "y", "z", "length", "width", "height", "sin", "cos", "vx", "vy")
"""Columns of the network's output ``box``, in the LiDAR's frame: centre of the volume, size, heading, velocity over
ground."""


@dataclass(frozen=True)
class DetectorNetwork:
    """A network that finds boxes, with its card."""

    session: Any
    card: Mapping[str, Any]
    grid: PillarGrid
    class_names: tuple[str, ...]

    def run(self, pillars: Pillars) -> tuple[Floats, Floats, Floats]:
        """Run the network.

        Gives boxes ``(K, 10)``, scores ``(K,)`` and shares of the classes ``(K, C)``, best first.
        """
        if not len(pillars):
            return np.zeros((0, len(BOX_COLUMNS))), np.zeros(0), np.zeros((0, len(self.class_names)))
        box, score, share = self.session.run(OUTPUTS, {"points": pillars.points, "cell": pillars.cell})
        return box.astype(np.float64), score.astype(np.float64), share.astype(np.float64)


def load_detector(path: Path) -> DetectorNetwork:
    """Load a detector, which runs on one processor.

    Raises:
        InputError: No such file, no card, weights that are not the card's, or another form.
    """
    network = open_network(path)
    card, inputs = network.card, network.session.get_inputs()
    if card.get("form_version") != FORM_VERSION or not isinstance(card.get("grid"), dict):
        raise InputError("checkpoint", str(path), f"a detector of form {FORM_VERSION}, not {card.get('form_version')}")
    grid = PillarGrid.from_json(card["grid"])
    if [tensor.name for tensor in inputs] != list(INPUTS) or inputs[0].shape[1:] != [grid.points, len(FEATURES)]:
        raise InputError("checkpoint", str(path), f"inputs {', '.join(INPUTS)} as the card's grid has them")
    return DetectorNetwork(network.session, card, grid, tuple(card["class_names"]))


def seen_in_training(weights: Path | None = None) -> SeenEpisodes | None:
    """Episodes in a detector's training, from its card; ``weights`` as in ``detect_pillars``.

    Raises:
        InputError: The weights cannot be used.
    """
    return SeenEpisodes.of_card(load_detector(weights or detector_file(SHIPPED_DETECTOR)).card)


_OWN_HALF_M: Final = (4.2, 1.35)
"""Half length and half width of a box around the carrier; returns inside it come from the carrier itself."""


class _Sweep(NamedTuple):
    step: int
    xyzi: Floats32
    map_from_lidar: Matrix


@dataclass
class SweepMemory:
    """Stores the last sweeps of one sensor."""

    sweeps: int
    """Number of sweeps, including the newest."""
    _held: list[_Sweep] = field(default_factory=list)

    def add(self, step: int, points: npt.NDArray[np.void], map_from_lidar: Matrix) -> None:
        """Add the sweep of a step. If the step is not later than the last one, earlier sweeps are deleted.

        The points have the fields x, y, z and intensity and are in the LiDAR's frame.
        """
        if self._held and step <= self._held[0].step:
            self._held.clear()
        columns = [points[name].astype(np.float32) for name in ("x", "y", "z", "intensity")]
        xyzi = np.stack(columns, axis=-1)
        own = (abs(xyzi[:, 0]) < _OWN_HALF_M[0]) & (abs(xyzi[:, 1]) < _OWN_HALF_M[1])
        self._held.insert(0, _Sweep(step, xyzi[~own], map_from_lidar))
        del self._held[self.sweeps :]

    @property
    def newest(self) -> tuple[int, Matrix] | None:
        """Step and transform ``map_from_lidar`` of the newest sweep; None without a sweep."""
        return (self._held[0].step, self._held[0].map_from_lidar) if self._held else None

    def points(self) -> Floats32:
        """All points in the frame of the newest sweep, newest first: x, y, z, intensity, age in seconds."""
        if not self._held:
            return np.zeros((0, 5), dtype=np.float32)
        newest = self._held[0]
        lidar_from_map = np.linalg.inv(newest.map_from_lidar)
        parts = []
        for sweep in self._held:
            age_s = (newest.step - sweep.step) * STEP_S
            table = np.empty((len(sweep.xyzi), 5), dtype=np.float32)
            table[:, :3] = sweep.xyzi[:, :3]
            if sweep is not newest:
                moved = lidar_from_map @ sweep.map_from_lidar
                table[:, :3] = sweep.xyzi[:, :3] @ moved[:3, :3].T.astype(np.float32) + moved[:3, 3].astype(np.float32)
            table[:, 3], table[:, 4] = sweep.xyzi[:, 3], age_s
            parts.append(table)
        return np.concatenate(parts)


SHIPPED: Final = Path("detectors", "pillars.onnx")
"""Place of the shipped weights below the parameter files."""
_LEAST_SCORE: Final = 0.03
_APART_M: Final = 1.8
"""Least distance of two vehicles' centres, the width of a car; of two closer boxes one is dropped."""


def detector_file(name: str) -> Path:
    """ONNX file of a detector: ``pillars`` is the shipped one, other names are paths."""
    return params_dir() / SHIPPED if name == SHIPPED_DETECTOR else Path(name)


@dataclass
class PillarDetector:
    """Finds vehicles in the newest sweep of one LiDAR, with earlier sweeps, and tracks them for velocities."""

    network: DetectorNetwork
    height_m: float = SENSOR_HEIGHT_M
    """Height of the LiDAR above the ground."""
    memory: SweepMemory = field(init=False)
    tracker: Tracker = field(default_factory=Tracker)

    def __post_init__(self) -> None:
        self.memory = SweepMemory(self.network.grid.sweeps)

    def add(self, step: int, points: npt.NDArray[np.void], map_from_lidar: Matrix) -> None:
        """Add the sweep of a step; see ``SweepMemory.add``."""
        if self.memory.newest is not None and step <= self.memory.newest[0]:
            self.tracker = Tracker(step=step)
        self.memory.add(step, points, map_from_lidar)

    def boxes(self) -> FoundBoxes:
        """Vehicles in the newest sweep, in the LiDAR's frame; their frame number is 0."""
        grid, names = self.network.grid, np.array(self.network.class_names)
        points, lift_m = self.memory.points(), self.height_m - SENSOR_HEIGHT_M
        points[:, 2] += np.float32(lift_m)
        table, score, share = self.network.run(pillars_of(points, grid))
        table[:, 2] -= lift_m
        kept = (score >= _LEAST_SCORE) & np.isfinite(table).all(axis=1)
        kept[kept] = apart(table[kept, :2], score[kept], _APART_M)
        table = table[kept]
        velocity = self._velocities(table[:, :3], table[:, 8:10])
        return FoundBoxes(
            frame=np.zeros(len(table), dtype=np.intp),
            centre_m=table[:, :3],
            size_m=table[:, 3:6],
            yaw_rad=np.arctan2(table[:, 6], table[:, 7]),
            velocity_mps=velocity,
            attribute=attributes_of(velocity),
            score=score[kept],
            label=names[share[kept].argmax(axis=1)],
        )

    def _velocities(self, centre_m: Floats, stated_mps: Floats) -> Floats:
        """Velocities from the tracker, which filters those of the network, in the LiDAR's frame."""
        if self.memory.newest is None:
            return stated_mps
        step, map_from_lidar = self.memory.newest
        turn = map_from_lidar[:2, :2]
        place_m = (centre_m @ map_from_lidar[:3, :3].T + map_from_lidar[:3, 3])[:, :2]
        return self.tracker.follow(step, place_m, STEP_S, stated_mps @ turn.T).velocity_mps @ turn


def apart(centre_m: Floats, score: Floats, least_m: float) -> Flags:
    """Keep a box unless one with a higher score is nearer than this distance (CenterPoint's circle NMS)."""
    order = np.argsort(-score, kind="stable")
    stays: Flags = np.zeros(len(score), dtype=np.bool_)
    for row in order:
        away = centre_m[stays] - centre_m[row]
        stays[row] = not (np.hypot(away[:, 0], away[:, 1]) < least_m).any()
    return stays


def detect_pillars(episode: EpisodeFrames, weights: Path | None = None) -> FoundBoxes:
    """Detect vehicles in all labelled sweeps of an episode, in the ``map`` frame.

    The weights are an ONNX file with its card; None stands for those that ship.

    Raises:
        InputError: The weights cannot be used.
        BagError: The bag is damaged.
    """
    network = load_detector(weights or detector_file(SHIPPED_DETECTOR))
    frame_of_step = episode.frame_of_step
    parts = [FoundBoxes.none()]
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
    return joined(parts)


def _in_map(frame: int, boxes: FoundBoxes, map_from_lidar: Matrix) -> FoundBoxes:
    turn, shift = map_from_lidar[:3, :3], map_from_lidar[:3, 3]
    return replace(
        boxes,
        frame=np.full(len(boxes), frame, dtype=np.intp),
        centre_m=boxes.centre_m @ turn.T + shift,
        yaw_rad=boxes.yaw_rad + np.arctan2(turn[1, 0], turn[0, 0]),
        velocity_mps=boxes.velocity_mps @ turn[:2, :2].T,
    )
