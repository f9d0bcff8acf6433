"""Average precision as nuScenes defines it, for any weights of the episodes.

Source: nuscenes-devkit, ``nuscenes/eval/detection/algo.py`` (``accumulate`` and ``calc_ap``): precision is interpolated
at 101 recalls; recalls up to 0.1 and precision below 0.1 do not count.
"""

from typing import Final

import numpy as np

from siren_ros.numerics.arrays import Flags, Floats, Rows
from siren_ros.numerics.compiled import compiled

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
