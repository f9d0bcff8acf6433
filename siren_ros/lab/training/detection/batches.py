"""Batches for the detector's training: drawn frames with augmentation, and CenterPoint's targets.

A batch is a function of seed and step, so that a run that goes on draws the same frames.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from siren_ros.base.numerics.arrays import Floats, Floats32
from siren_ros.lab.training.detection.samples import BagFrames, TrainingFrame
from siren_ros.scoring.evaluation.detection.detectors.pillars import PillarGrid, Pillars, pillars_of

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
