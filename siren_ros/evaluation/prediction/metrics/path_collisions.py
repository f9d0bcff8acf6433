"""Collisions between predicted paths: a prediction of a scene should not drive one vehicle through another."""

from typing import Any, Final

import numpy as np

from siren_ros.evaluation.prediction.protocol.hypotheses import Hypotheses
from siren_ros.evaluation.prediction.protocol.samples import SampleBatch
from siren_ros.numerics.arrays import Floats
from siren_ros.numerics.boxes import box_gap_m
from siren_ros.numerics.compiled import compiled

STILL_M: Final = 0.1
"""Between two points of a path, 0.2 s apart: a shorter leg does not turn the vehicle."""


def colliding(hypotheses: Hypotheses, batch: SampleBatch) -> Floats:
    """1 where the footprint on the most probable path overlaps that of another sample of the same frame, else 0.

    Both footprints are at the same time, any of the grid's. A footprint points along its path, and keeps its heading
    where the vehicle stands.

    Returns:
        Shape ``(N,)``; NaN where the frame has no other sample.
    """
    path = hypotheses.xy_m[:, 0]
    heading = _headings(path, batch)
    own = batch.target
    frame = batch.actors.frame[own]
    first, count = np.unique(frame, return_index=True, return_counts=True)[1:]
    hit = np.zeros(len(path))
    sizes = 0.5 * np.stack((batch.actors.length_m[own], batch.actors.width_m[own]))
    _mark(path, np.cos(heading), np.sin(heading), sizes, first, first + count, hit)
    return np.where(np.repeat(count, count) > 1, hit, np.nan) if len(hit) else hit


def _headings(path: Floats, batch: SampleBatch) -> Floats:
    """Heading at each point, shape ``(N, T)``: of the leg that leads there, of the one before where it is short."""
    legs = np.diff(np.concatenate((batch.xy_m[:, None], path), axis=1), axis=1)
    moves = np.hypot(legs[..., 0], legs[..., 1]) > STILL_M
    heading = np.arctan2(legs[..., 1], legs[..., 0])
    before = batch.yaw_rad
    for point in range(path.shape[1]):
        before = np.where(moves[:, point], heading[:, point], before)
        heading[:, point] = before
    return heading


@compiled
def _mark(path: Any, cos: Any, sin: Any, half: Any, first: Any, end: Any, hit: Any) -> None:
    """Set ``hit`` to 1 for all samples whose boxes overlap another one's of their frame."""
    for frame in range(len(first)):
        for a in range(first[frame], end[frame]):
            for b in range(a + 1, end[frame]):
                if hit[a] > 0.0 and hit[b] > 0.0:
                    continue
                reach = np.hypot(half[0, a], half[1, a]) + np.hypot(half[0, b], half[1, b])
                for t in range(path.shape[1]):
                    dx, dy = path[b, t, 0] - path[a, t, 0], path[b, t, 1] - path[a, t, 1]
                    if dx * dx + dy * dy >= reach * reach:
                        continue
                    one = (path[a, t, 0], path[a, t, 1], cos[a, t], sin[a, t])
                    other = (path[b, t, 0], path[b, t, 1], cos[b, t], sin[b, t])
                    if box_gap_m(one, other, half[0, a], half[1, a], half[0, b], half[1, b]) < 0.0:
                        hit[a] = hit[b] = 1.0
                        break
