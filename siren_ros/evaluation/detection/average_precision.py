"""Matches of detections with labels, and the average precision of them, by nuScenes' rules.

The devkit's code makes all printed values of the templates. The code here repeats its matching and its average
precision for many subsets of episodes and labels at once, which the devkit cannot do in reasonable time.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np

from siren_ros.evaluation.detection.boxes import FoundBoxes, TruthBoxes
from siren_ros.numerics.arrays import Flags, Floats, Rows
from siren_ros.numerics.compiled import compiled

DISTANCES_M: Final = (0.5, 1.0, 2.0, 4.0)
"""nuScenes' thresholds."""


@dataclass(frozen=True)
class Matches:
    """Detections from the most to the least confident, and the label that each one takes."""

    order: Rows
    """Rows of the detections, shape ``(N,)``."""
    label: Rows
    """Row of the label of each detection in this order, −1 without one, shape ``(D, N)``: one row per distance."""


def match(truth: TruthBoxes, found: FoundBoxes) -> Matches:
    """Each detection, from the most confident on, takes the nearest label of its frame that is still free."""
    # The devkit sorts pairs of score and number and turns the list around: the later one of equal scores comes first.
    order = np.lexsort((np.arange(len(found)), found.score))[::-1].astype(np.intp)
    by_frame = np.argsort(truth.frame, kind="stable")
    frames = truth.frame[by_frame]
    frame = found.frame[order]
    first = np.searchsorted(frames, frame, side="left")
    last = np.searchsorted(frames, frame, side="right")
    places = np.ascontiguousarray(truth.centre_m[by_frame, :2])
    rows = np.full((len(DISTANCES_M), len(order)), -1, dtype=np.intp)
    _match(np.ascontiguousarray(found.centre_m[order, :2]), first, last, places, np.array(DISTANCES_M), rows)
    taken = rows >= 0
    rows[taken] = by_frame[rows[taken]]
    return Matches(order, rows)


@compiled
def _match(found: Floats, first: Rows, last: Rows, truth: Floats, limits_m: Floats, rows: Rows) -> None:
    for distance in range(len(limits_m)):
        free = np.ones(len(truth), dtype=np.bool_)
        for number in range(len(found)):
            nearest, chosen = np.inf, -1
            for row in range(first[number], last[number]):
                if free[row]:
                    away = np.hypot(found[number, 0] - truth[row, 0], found[number, 1] - truth[row, 1])
                    if away < nearest:
                        nearest, chosen = away, row
            if nearest < limits_m[distance]:
                free[chosen] = False
                rows[distance, number] = chosen


_GRID: Final = np.linspace(0.0, 1.0, 101)
"""The devkit's recalls. Some differ from hundredths in the last bit, which decides which recalls are reached."""
_MIN_RECALL_BIN: Final = 10
_MIN_PRECISION: Final = 0.1


def average_precision(hit: Flags, episode: Rows, labels: Floats, weight: Floats) -> Floats:
    """AP for each choice of weights, shape ``(R,)``; NaN where the weighted episodes hold no label.

    Args:
        hit: Whether each detection has a label, from the most confident on, shape ``(N,)``.
        episode: Episode of each detection, shape ``(N,)``.
        labels: Number of labels of each episode, shape ``(E,)``.
        weight: How often each episode counts, shape ``(R, E)``.
    """
    result = np.full(len(weight), np.nan)
    _average_precisions(hit, episode, labels, np.ascontiguousarray(weight), _GRID, result)
    return result


@compiled
def _precisions(hit: Flags, counted: Floats, labels: float, grid: Floats, precision: Floats) -> None:
    """Precision at the recalls 0, 0.01, … 1 by linear interpolation, as ``numpy.interp`` with ``right=0``."""
    precision[:] = 0.0
    hits, misses = 0.0, 0.0
    recall_before, precision_before = -1.0, 0.0
    place = 0
    for number in range(len(hit)):
        if counted[number] == 0.0:
            continue
        hits += counted[number] * hit[number]
        misses += counted[number] * (1.0 - hit[number])
        recall, value = hits / labels, hits / (hits + misses)
        slope = (value - precision_before) / (recall - recall_before) if recall > recall_before >= 0.0 else 0.0
        start = precision_before if recall_before >= 0.0 else value
        while place < len(grid) and grid[place] < recall:
            precision[place] = slope * (grid[place] - recall_before) + start
            place += 1
        recall_before, precision_before = recall, value
    if place < len(grid) and grid[place] == recall_before:
        precision[place] = precision_before


@compiled
def _average_precisions(
    hit: Flags, episode: Rows, labels: Floats, weight: Floats, grid: Floats, result: Floats
) -> None:
    precision = np.zeros(len(grid))
    for draw in range(len(weight)):
        total = (weight[draw] * labels).sum()
        if total == 0.0:
            continue
        _precisions(hit, weight[draw][episode], total, grid, precision)
        clipped = np.maximum(precision[_MIN_RECALL_BIN + 1 :] - _MIN_PRECISION, 0.0)
        result[draw] = clipped.mean() / (1.0 - _MIN_PRECISION)
