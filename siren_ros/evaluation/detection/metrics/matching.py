"""Which box belongs to which label: nuScenes' greedy matching by distance, compiled, at several distances at once.

It gives the same pairs as ``nuscenes.eval.detection.algo.accumulate``, which is tested. The devkit's loop is used for
the tables; this one for subsets of labels and for intervals, which need many more passes.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np

from siren_ros.evaluation.detection.protocol.boxes import FoundBoxes, TruthBoxes
from siren_ros.numerics.arrays import Floats, Rows
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
    wanted = found.frame[order]
    first = np.searchsorted(frames, wanted, side="left")
    last = np.searchsorted(frames, wanted, side="right")
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
