"""Training frames of the detector, cached in files, and batches of them with CenterPoint's targets.

A frame has sweeps and labels of a bag. A batch is drawn with augmentation; it is a function of seed and step, so that a
run that goes on draws the same frames.
"""

import hashlib
import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from siren_ros.base.numerics.arrays import Floats, Floats32
from siren_ros.base.numerics.units import STEP_S, STEPS_PER_S
from siren_ros.data.episode_source import lidar_frames, lidar_of, open_source
from siren_ros.data.recording.bag_folder import METADATA_FILE
from siren_ros.data.recording.bag_reader import bags_among
from siren_ros.errors import InputError, writing
from siren_ros.lab.training.data_files import read_arrays, write_arrays
from siren_ros.scoring.evaluation.detection.pillar_detector import (
    SENSOR_HEIGHT_M,
    PillarGrid,
    Pillars,
    SweepMemory,
    class_of,
    pillars_of,
    sorted_points,
)
from siren_ros.simulation.scenario.episode import EpisodeIdentity
from siren_ros.simulation.world.actors import PEOPLE_CLASSES
from siren_ros.simulation.world.carrier import GroundTruth

FRAME_PERIOD_STEPS: Final = STEPS_PER_S // 2
"""Steps between training frames: two per second, like nuScenes' keyframes."""
BOX_COLUMNS: Final = ("x", "y", "z", "length", "width", "height", "yaw", "vx", "vy", "class", "points")
_SPARE: Final = 1.5
"""Factor by which a file keeps more points per pillar than a network gets, because augmentation moves points."""
_METRE: Final = 512
"""Number of stored coordinate steps per metre."""


@dataclass(frozen=True)
class TrainingFrame:
    """One frame in the LiDAR's frame."""

    points: Floats32
    """Points for ``sorted_points``, shape ``(N, 5)``."""
    boxes: Floats32
    """Boxes with columns ``BOX_COLUMNS`` and the class as index into ``CLASS_NAMES``, shape ``(B, 11)``."""


@dataclass(frozen=True)
class BagFrames:
    """Frames of one episode with points in compact form."""

    about: dict[str, Any]
    """Template, level, seed, map and version of the episode."""
    xyz: npt.NDArray[np.int16]
    intensity_age: npt.NDArray[np.uint8]
    first_point: npt.NDArray[np.int64]
    """Index of each frame's first point, shape ``(F + 1,)``."""
    boxes: Floats32
    first_box: npt.NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.first_point) - 1

    def digest(self) -> bytes:
        """Hash of all points and labels; equal frames have the same hash, whatever the bag's name and time."""
        parts = (self.xyz, self.intensity_age, self.first_point, self.boxes, self.first_box)
        return hashlib.sha256(b"".join(part.tobytes() for part in parts)).digest()

    def frame(self, number: int) -> TrainingFrame:
        """One frame by its number."""
        part = slice(self.first_point[number], self.first_point[number + 1])
        points = np.empty((part.stop - part.start, 5), dtype=np.float32)
        points[:, :3] = self.xyz[part].astype(np.float32) / _METRE
        points[:, 3] = self.intensity_age[part, 0].astype(np.float32) / 255.0
        points[:, 4] = self.intensity_age[part, 1].astype(np.float32) * STEP_S
        return TrainingFrame(points, self.boxes[self.first_box[number] : self.first_box[number + 1]])


def frames_of_bag(bag: Path, grid: PillarGrid) -> BagFrames:
    """Read an episode, two frames per second; BagError if the bag is damaged or has no LiDAR."""
    kept = replace(grid, points=int(_SPARE * grid.points))
    points: list[Floats32] = []
    boxes: list[Floats32] = []
    with open_source(bag) as source:
        base_from_lidar = lidar_of(source).base_from_sensor
        memory, lift_m = SweepMemory(grid.sweeps), np.float32(base_from_lidar[2, 3] - SENSOR_HEIGHT_M)
        for frame in lidar_frames(source, pose=True):
            if frame.points is None or frame.map_from_base is None:
                continue
            memory.add(frame.step, frame.points, frame.map_from_base @ base_from_lidar)
            if frame.truth is None or frame.step % FRAME_PERIOD_STEPS or frame.step < grid.sweeps:
                continue
            lifted = memory.points()
            lifted[:, 2] += lift_m
            held = sorted_points(lifted, kept)
            there = np.arange(kept.points) < held.count[:, None]
            points.append(held.slots[there])
            boxes.append(boxes_of_truth(frame.truth))
            boxes[-1][:, 2] += lift_m
    return joined_frames(about_episode(bag), points, boxes)


def about_episode(bag: Path) -> dict[str, Any]:
    """Template, level, seed and map of a bag's episode, and what decides its split (``EpisodeIdentity.text``)."""
    with open_source(bag) as source:
        episode = source.description
    names, identity = {"template": episode.template, "level": episode.level.name}, EpisodeIdentity.of(episode)
    keys = {"key": identity.text, "content": identity.content}
    return {**names, "seed": episode.seed, "map": episode.map_name, **keys}


def boxes_of_truth(truth: GroundTruth) -> Floats32:
    """Labels of the vehicles at one step, shape ``(B, 11)``; people have none and belong to the background."""
    vehicles = ~np.isin(truth.actor_class, [*PEOPLE_CLASSES])
    classes = [class_of(int(code)) for code in truth.actor_class]
    columns = (
        *(truth.x_m, truth.y_m, truth.z_m),
        *(truth.length_m, truth.width_m, truth.height_m),
        *(truth.yaw_rad, truth.vx_mps, truth.vy_mps),
        *(classes, truth.lidar_points),
    )
    return np.stack([np.asarray(column, dtype=np.float32) for column in columns], axis=-1)[vehicles]


def joined_frames(about: dict[str, Any], points: Sequence[Floats32], boxes: Sequence[Floats32]) -> BagFrames:
    """Join frames in compact form; points and boxes of each frame as in ``TrainingFrame``."""
    table = np.concatenate(points) if points else np.zeros((0, 5), dtype=np.float32)
    fine = np.stack((np.rint(table[:, 3] * 255.0), np.rint(table[:, 4] / STEP_S)), axis=-1)
    return BagFrames(
        about=about,
        xyz=np.rint(table[:, :3] * _METRE).astype(np.int16),
        intensity_age=np.clip(fine, 0, 255).astype(np.uint8),
        first_point=np.cumsum([0, *map(len, points)]),
        boxes=np.concatenate(boxes) if boxes else np.zeros((0, len(BOX_COLUMNS)), dtype=np.float32),
        first_box=np.cumsum([0, *map(len, boxes)]),
    )


def write_frames(path: Path, frames: BagFrames) -> None:
    """Write a file completely or not at all."""
    arrays = {field.name: getattr(frames, field.name) for field in fields(BagFrames) if field.name != "about"}
    write_arrays(path, {"about": np.array(json.dumps(frames.about)), **arrays}, compressed=False)


def read_frames_file(path: Path) -> BagFrames:
    """Read a file of ``write_frames``."""
    about, arrays = read_arrays(path, "about")
    return BagFrames(about=about, **arrays)


FRAMES_SUFFIX: Final = ".npz"
_FORM: Final = 2
"""Version of the files; it is part of their names."""


def frames_among(
    paths: Sequence[Path], folder: Path, grid: PillarGrid, report: Callable[[str], None]
) -> tuple[BagFrames, ...]:
    """Frames of bags, of folders with bags, or of cached files, in the order of their paths.

    Files of frames are kept in the folder. ``report`` is called with a line for each bag that was read.

    Raises:
        BagError: A bag is damaged or has no LiDAR.
        InputError: A file cannot be read, or none holds a frame.
    """
    files = [path for path in paths if path.suffix == FRAMES_SUFFIX]
    episodes = [_read(path) for path in files]
    for bag in bags_among(path for path in paths if path not in files):
        file = folder / f"{bag.name}-{_digest(bag, grid)}{FRAMES_SUFFIX}"
        if not file.exists():
            frames = frames_of_bag(bag, grid)
            with writing(file.parent, "folder", "cache"):
                write_frames(file, frames)
            report(f"{bag}: {len(frames)} frames")
        episodes.append(_read(file))
    if not sum(map(len, episodes)):
        raise InputError("bags", ", ".join(map(str, paths)), "at least one episode with labelled sweeps")
    return tuple(episodes)


def check_apart(trained: Iterable[Mapping[str, Any]], judged: Iterable[Mapping[str, Any]]) -> None:
    """Check that no judged episode shares map and seed with a training episode.

    Raises:
        InputError: The first such episode.
    """
    taken = {(about["map"], about["seed"]) for about in trained}
    for about in judged:
        if (about["map"], about["seed"]) in taken:
            episode = f"{about['template']} on {about['map']}, seed {about['seed']}"
            raise InputError("held_out", episode, "seeds or maps that are not trained on")


def _digest(bag: Path, grid: PillarGrid) -> str:
    try:
        metadata = (bag / METADATA_FILE).read_bytes()
    except OSError as error:
        raise InputError("bag", str(bag), f"a finished bag ({error.strerror})") from error
    text = json.dumps([_FORM, grid.to_json()], sort_keys=True).encode()
    return hashlib.sha256(metadata + text).hexdigest()[:12]


def _read(file: Path) -> BagFrames:
    try:
        return read_frames_file(file)
    except TypeError as error:
        raise InputError("frames", str(file), f"a file of frames of an earlier run ({error})") from error


_SCALE: Final = 0.05
_LIFT_M: Final = 0.2
_EXTINCTION_PER_M: Final = 0.03
"""Largest extinction of the air, slightly above that of the look ``fog``; light passes it twice."""


def turned(frame: TrainingFrame, angle_rad: float, *, mirrored: bool, scale: float) -> TrainingFrame:
    """Mirror the frame about the x axis, then turn it counter-clockwise and scale it, with its labels."""
    points, boxes = frame.points.copy(), frame.boxes.copy()
    if mirrored:
        points[:, 1] *= -1.0
        boxes[:, [1, 6, 8]] *= -1.0
    points[:, :2], boxes[:, :2], boxes[:, 7:9] = (
        _rotated(part, angle_rad) for part in (points[:, :2], boxes[:, :2], boxes[:, 7:9])
    )
    boxes[:, 6] += np.float32(angle_rad)
    points[:, :3] *= np.float32(scale)
    boxes[:, [0, 1, 2, 3, 4, 5, 7, 8]] *= np.float32(scale)
    return TrainingFrame(points, boxes)


def varied(frame: TrainingFrame, random: np.random.Generator) -> TrainingFrame:
    """Random variant: any direction, mirrored or not, scaled by up to 5 %, other height, clear air or fog."""
    angle = float(random.uniform(-np.pi, np.pi))
    scale = float(random.uniform(1.0 - _SCALE, 1.0 + _SCALE))
    variant = turned(frame, angle, mirrored=bool(random.random() < 0.5), scale=scale)
    lift = np.float32(random.uniform(-_LIFT_M, _LIFT_M))
    variant.points[:, 2] += lift
    variant.boxes[:, 2] += lift
    extinction = np.float32(max(0.0, random.uniform(-_EXTINCTION_PER_M, _EXTINCTION_PER_M)))
    variant.points[:, 3] *= np.exp(-2.0 * extinction * np.hypot(variant.points[:, 0], variant.points[:, 1]))
    return variant


def _rotated(xy: Floats32, angle_rad: float) -> Floats32:
    cos, sin = np.float32(np.cos(angle_rad)), np.float32(np.sin(angle_rad))
    return np.stack((cos * xy[:, 0] - sin * xy[:, 1], sin * xy[:, 0] + cos * xy[:, 1]), axis=-1)


STRIDE: Final = 4
"""Size of an output cell in pillars."""
BOX_CHANNELS: Final = ("dx", "dy", "z", "log_length", "log_width", "log_height", "sin", "cos", "vx", "vy")
"""Channels of a box: offsets from the middle of the cell in metres; heading as sine and cosine."""
_LEAST_OVERLAP: Final = 0.1
_LEAST_RADIUS: Final = 1
_NEAR: Final = 1
"""Boxes are learned in the cell of the centre and in cells up to this far around it, since the highest cell may be a
neighbour."""


@dataclass(frozen=True)
class Targets:
    """Targets of one frame with R rows and columns."""

    heat: Floats32
    """Heat map: 1 in the cells of centres, decreasing around them, shape ``(R, R)``."""
    counts: Floats32
    """Weight of the heat map, 0 in cells of vehicles that only older sweeps hit; shape ``(R, R)``."""
    cell: npt.NDArray[np.int64]
    """Cells with a box, ``row * R + column``, shape ``(T,)``."""
    box: Floats32
    """Channels of these cells' boxes, shape ``(T, 10)``."""
    weight: Floats32
    """Weight of each of these cells, shape ``(T,)``."""
    label: npt.NDArray[np.int64]
    """Index into ``CLASS_NAMES``, shape ``(T,)``."""


def gaussian_radius(length: float, width: float, least_overlap: float = _LEAST_OVERLAP) -> float:
    """Largest shift of a box along both axes that keeps an overlap (IoU) with itself of the given share.

    With a shift of r along both axes the overlap is ``(l - r)(w - r)``, which over the union is the least IoU at the
    smaller root of ``r² - (l + w) r + l w (1 - o) / (1 + o) = 0`` (CornerNet).
    """
    total, area = length + width, length * width * (1.0 - least_overlap) / (1.0 + least_overlap)
    return float((total - np.sqrt(total * total - 4.0 * area)) / 2.0)


def targets_of(boxes: Floats32, grid: PillarGrid) -> Targets:
    """Targets for the labels of a frame; columns of ``boxes`` as in ``BOX_COLUMNS``."""
    rows = grid.cells // STRIDE
    cell_m = STRIDE * grid.cell_m
    heat, counts = np.zeros((rows, rows), dtype=np.float32), np.ones((rows, rows), dtype=np.float32)
    nearness = np.zeros((rows, rows))
    owner = np.full((rows, rows), -1)
    for number, box in enumerate(boxes.astype(np.float64)):
        at = (box[:2] + grid.half_width_m) / cell_m
        column, row = (int(value) for value in np.floor(at))
        if not (0 <= row < rows and 0 <= column < rows):
            continue
        radius = max(_LEAST_RADIUS, int(gaussian_radius(box[3] / cell_m, box[4] / cell_m)))
        window, shape = _bump(row, column, radius, rows)
        if box[10] < 1.0:
            counts[window] = 0.0
            continue
        heat[window] = np.maximum(heat[window], shape)
        window, shape = _bump(row, column, _NEAR, rows)
        nearer = shape > nearness[window]
        nearness[window] = np.where(nearer, shape, nearness[window])
        owner[window] = np.where(nearer, number, owner[window])
    counts[heat > 0.0] = 1.0
    line, column_of = np.nonzero(owner >= 0)
    owners = boxes[owner[line, column_of]].astype(np.float64)
    middle = (np.stack((column_of, line), axis=-1) + 0.5) * cell_m - grid.half_width_m
    channels = (
        owners[:, :2] - middle,
        owners[:, 2:3],
        np.log(np.maximum(owners[:, 3:6], 0.1)),
        np.sin(owners[:, 6:7]),
        np.cos(owners[:, 6:7]),
        owners[:, 7:9],
    )
    return Targets(
        heat=heat,
        counts=counts,
        cell=(line * rows + column_of).astype(np.int64),
        box=np.concatenate(channels, axis=1).astype(np.float32),
        weight=nearness[line, column_of].astype(np.float32),
        label=owners[:, 9].astype(np.int64),
    )


def _bump(row: int, column: int, radius: int, rows: int) -> tuple[tuple[slice, slice], Floats]:
    """A Gaussian around a cell, cut at the border: its cells and values."""
    window = tuple(slice(max(0, at - radius), min(rows, at + radius + 1)) for at in (row, column))
    away = [np.arange(part.start, part.stop) - at for part, at in zip(window, (row, column), strict=True)]
    sigma = (2 * radius + 1) / 6.0
    shape: Floats = np.exp(-(away[0][:, None] ** 2 + away[1][None] ** 2) / (2.0 * sigma * sigma))
    return (window[0], window[1]), shape


@dataclass(frozen=True)
class FrameDraws:
    """All training frames, in a new random order in every pass."""

    episodes: Sequence[BagFrames]
    grid: PillarGrid
    seed: int
    batch: int

    def __len__(self) -> int:
        return sum(len(episode) for episode in self.episodes)

    def rows(self, step: int) -> list[int]:
        """Numbers of the frames of a training step."""
        places = [divmod(position, len(self)) for position in range(step * self.batch, (step + 1) * self.batch)]
        return [int(np.random.default_rng([self.seed, turn]).permutation(len(self))[place]) for turn, place in places]

    def batch_of(self, step: int) -> list[tuple[Pillars, Targets]]:
        """Pillars and targets of the frames of a training step, augmented."""
        random = np.random.default_rng([self.seed, 1, step])
        ends = np.cumsum([len(episode) for episode in self.episodes])
        batch = []
        for row in self.rows(step):
            number = int(np.searchsorted(ends, row, side="right"))
            episode = self.episodes[number]
            frame = varied(episode.frame(row - int(ends[number]) + len(episode)), random)
            batch.append((pillars_of(frame.points, self.grid), targets_of(frame.boxes, self.grid)))
        return batch
