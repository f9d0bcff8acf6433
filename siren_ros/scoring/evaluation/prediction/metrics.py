"""Metrics of trajectory prediction (paper, supplement "Evaluation Metrics"): one function each, and the table.

The truth has shape ``(N, T, 2)``; every function gives a value for each sample, shape ``(N,)``. Of a sample, the *best*
hypothesis is the one among the six most probable that ends nearest to the truth. The probabilities of the six are
scaled to the sum 1, as Argoverse 2 does. Calibration: hypotheses with probability p should be the best ones in a share
p of the cases. Collisions: a prediction of a scene should not drive one vehicle through another.

Joint errors: Argoverse 2 calls a set of one path for each vehicle of a frame a *world* (``av2``: ``compute_world_fde``,
``compute_world_ade``); its error is the mean over the vehicles. The models here predict each vehicle by itself, so
world k has every vehicle's k-th most probable path; a vehicle with fewer paths keeps its last one.

On the road: whether predicted paths stay on the road and follow its direction, with a raster of the road network.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt
from matplotlib.path import Path as Outline

from siren_ros.base.numerics.arrays import Codes, Flags, Floats, Rows
from siren_ros.base.numerics.compiled import X, Y, box_gap_m, compiled
from siren_ros.base.numerics.geometry import wrap_angle
from siren_ros.data.tracks import DRIVEN_KINDS
from siren_ros.scoring.evaluation.prediction.predictors import Hypotheses
from siren_ros.scoring.evaluation.prediction.samples import (
    FRAME_PERIOD_S,
    FUTURE_STRIDE_FRAMES,
    SampleBatch,
    ScoredSamples,
)
from siren_ros.scoring.evaluation.statistics import identity
from siren_ros.simulation.roads.road_network import MAPS_KEPT, LaneKind, RoadNetwork

CELL_M: Final = 0.5
"""Cell size of the raster; places up to one cell outside the road count as on it."""
_SPACING_M: Final = 0.4
_SECTORS: Final = 8
_STILL_M: Final = 0.1
"""A segment of a path (0.2 s) that is shorter than this has no direction."""


@dataclass(frozen=True)
class RoadRaster:
    """The road as cells: where it is, and which driving directions are allowed."""

    low_m: Floats
    """Lower corner of the first cell, shape ``(2,)``."""
    road: Flags
    """Whether a cell is on lanes, shoulders or junctions, shape ``(X, Y)``."""
    directions: Codes
    """Allowed directions: bit k means that a lane's heading is within 90° of k · 45°; all bits in junctions, 0 off the
    lanes. Shape ``(X, Y)``."""

    def cells(self, xy_m: Floats) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]:
        """Cells of positions with shape ``(…, 2)``.

        Positions outside the raster get a border cell, which is not road.
        """
        at = np.floor((xy_m - self.low_m) / CELL_M).astype(np.intp)
        return np.clip(at[..., 0], 0, self.road.shape[0] - 1), np.clip(at[..., 1], 0, self.road.shape[1] - 1)


@lru_cache(maxsize=MAPS_KEPT)
def road_raster(network: RoadNetwork) -> RoadRaster | None:
    """The raster of a map; None for a map without lanes."""
    lanes = [lane for lane in network.lanes if lane.kind in DRIVEN_KINDS]
    if not lanes:
        return None
    outlines = [junction.outline for junction in network.junctions.values() if len(junction.outline) > 2]
    corners = np.concatenate([lane.centre.points for lane in lanes] + outlines)
    low, high = corners.min(axis=0) - 20.0, corners.max(axis=0) + 20.0
    size = np.ceil((high - low) / CELL_M).astype(np.intp) + 1
    raster = RoadRaster(low, np.zeros(size, dtype=np.bool_), np.zeros(size, dtype=np.uint8))
    for lane in lanes:
        arc = np.linspace(0.0, lane.length_m, max(int(lane.length_m / _SPACING_M), 1) + 1)[:, None]
        aside = np.linspace(-0.5, 0.5, max(int(lane.width_m / _SPACING_M), 1) + 1)[None] * lane.width_m
        arc, aside = np.broadcast_arrays(arc, aside)
        at = raster.cells(lane.centre.offset_points(arc, aside))
        raster.road[at] = True
        bits = 255 if lane.kind is LaneKind.INTERNAL else _bits(lane.centre.heading_rad(arc))
        np.bitwise_or.at(raster.directions, at, bits)
    for outline in outlines:
        first, last = raster.cells(np.stack((outline.min(axis=0), outline.max(axis=0))))
        x, y = np.meshgrid(np.arange(first[0], first[1] + 1), np.arange(last[0], last[1] + 1), indexing="ij")
        middles = low + (np.stack((x, y), axis=-1) + 0.5) * CELL_M
        inside = Outline(outline).contains_points(middles.reshape(-1, 2)).reshape(x.shape)
        raster.road[x[inside], y[inside]] = True
        raster.directions[x[inside], y[inside]] = 255
    return RoadRaster(low, _grown(raster.road), raster.directions)


def _bits(heading_rad: Floats) -> Codes:
    sectors = 2.0 * np.pi / _SECTORS * np.arange(_SECTORS)
    near = np.abs(wrap_angle(heading_rad[..., None] - sectors)) <= 0.5 * np.pi + 1e-9
    return np.asarray((near * 2 ** np.arange(_SECTORS)).sum(axis=-1), dtype=np.uint8)


def _grown(cells: Flags) -> Flags:
    """Extend an area of cells by one cell on all sides."""
    grown = cells.copy()
    for axis in (0, 1):
        for shift in (-1, 1):
            grown |= np.roll(cells, shift, axis)
    return grown


def off_road(hypotheses: Hypotheses, samples: ScoredSamples) -> Floats:
    """1 where the most probable path's centre leaves lanes, shoulders and junctions, else 0; shape ``(N,)``.

    NaN where it is not on the road at the present.
    """
    raster = road_raster(samples.batch.network)
    if raster is None:
        return np.full(len(hypotheses), np.nan)
    leaves = ~raster.road[raster.cells(hypotheses.xy_m[:, 0])].all(axis=1)
    return np.where(raster.road[raster.cells(samples.batch.xy_m)], leaves, np.nan)


def wrong_way(hypotheses: Hypotheses, samples: ScoredSamples) -> Floats:
    """1 where the most probable path differs by more than 90° from all lanes at a place, else 0; shape ``(N,)``.

    Junctions have no wrong way. NaN where the vehicle itself stands against its lane at the present, as while it passes
    on the other side.
    """
    batch = samples.batch
    raster = road_raster(batch.network)
    if raster is None:
        return np.full(len(hypotheses), np.nan)
    path = hypotheses.xy_m[:, 0]
    legs = np.diff(np.concatenate((batch.xy_m[:, None], path), axis=1), axis=1)
    moves = np.hypot(legs[..., 0], legs[..., 1]) > _STILL_M
    against = moves & _against(raster, path, np.arctan2(legs[..., 1], legs[..., 0]))
    return np.where(_against(raster, batch.xy_m, batch.yaw_rad), np.nan, against.any(axis=1))


def _against(raster: RoadRaster, xy_m: Floats, heading_rad: Floats) -> Flags:
    allowed = raster.directions[raster.cells(xy_m)]
    sector = np.round(heading_rad / (2.0 * np.pi / _SECTORS)).astype(np.int64) % _SECTORS
    return np.asarray((allowed > 0) & (allowed >> sector & 1 == 0))


class MetricValue(NamedTuple):
    """Value of a metric over some samples."""

    value: float | None
    """The value; None without samples."""
    samples: int


@dataclass(frozen=True)
class Metric:
    """A metric with its name in files, its heading in tables, and its functions."""

    name: str
    label: str
    of_samples: Callable[[Hypotheses, ScoredSamples], Floats]
    """Gives a value per sample, shape ``(N,)``; NaN for samples to which the metric does not apply."""
    of_mean: Callable[[Floats], Floats] = identity
    """Applied to the mean over samples: for example the root of a mean of squares."""
    of_frames: bool = False
    """Whether the metric judges all vehicles of a frame together, so that it does not apply to some of them."""

    def value(self, of_samples: Floats) -> MetricValue:
        """The metric over some samples, from their values."""
        known = of_samples[~np.isnan(of_samples)]
        return MetricValue(float(self.of_mean(np.array([known.mean()]))[0]) if len(known) else None, len(known))


BEST_OF: Final = 6
"""k of minADE and minFDE; a predictor with fewer hypotheses is scored on those it has."""


def ade(hypotheses: Hypotheses, truth: Floats) -> Floats:
    """Mean distance over time of the most probable hypothesis, in metres."""
    return np.asarray(distances(hypotheses.xy_m[:, :1], truth)[:, 0].mean(axis=-1))


def fde(hypotheses: Hypotheses, truth: Floats) -> Floats:
    """Distance of the most probable hypothesis at the horizon, in metres."""
    return distances(hypotheses.xy_m[:, :1, -1:], truth[:, -1:])[:, 0, 0]


def min_ade_6(hypotheses: Hypotheses, truth: Floats) -> Floats:
    """Least mean distance over time of the six most probable hypotheses, in metres."""
    return np.asarray(distances(hypotheses.xy_m[:, :BEST_OF], truth).mean(axis=-1).min(axis=1))


def min_fde_6(hypotheses: Hypotheses, truth: Floats) -> Floats:
    """Least distance at the horizon of the six most probable hypotheses, in metres."""
    return np.asarray(distances(hypotheses.xy_m[:, :BEST_OF, -1:], truth[:, -1:])[..., 0].min(axis=1))


def squared_fde(hypotheses: Hypotheses, truth: Floats) -> Floats:
    """Square of the most probable hypothesis's distance at the horizon; the root of its mean is RMSE@5s."""
    return np.asarray(fde(hypotheses, truth) ** 2)


def distances(hypotheses_xy_m: Floats, truth: Floats) -> Floats:
    """Distances from the truth, shape ``(N, k, T)`` for hypotheses of shape ``(N, k, T, 2)``."""
    miss = hypotheses_xy_m - truth[:, None]
    return np.asarray(np.hypot(miss[..., 0], miss[..., 1]))


def brier_min_fde_6(hypotheses: Hypotheses, truth: Floats) -> Floats:
    """Final distance of the best hypothesis plus (1 − p)² for its probability: Argoverse 2's ranking metric."""
    best = best_of_six(hypotheses, truth)
    end = distances(hypotheses.xy_m[:, :BEST_OF, -1:], truth[:, -1:])[..., 0]
    return end[best] + (1.0 - probability_of_six(hypotheses)[best]) ** 2


def brier_score(hypotheses: Hypotheses, truth: Floats) -> Floats:
    """Sum of (p − y)² over the six, y = 1 for the best, else 0 (G. Brier, Mon. Weather Rev. 78 (1950) 1).

    NaN for every sample of a predictor with a single hypothesis: it makes no statement.
    """
    probability = probability_of_six(hypotheses)
    if probability.shape[1] < 2:
        return np.full(len(hypotheses), np.nan)
    return np.asarray(((probability - best_of_six(hypotheses, truth)) ** 2).sum(axis=1))


def probability_of_six(hypotheses: Hypotheses) -> Floats:
    """Probabilities of the six most probable hypotheses, scaled to the sum 1; shape ``(N, min(k, 6))``."""
    first = hypotheses.probability[:, :BEST_OF]
    return np.asarray(first / first.sum(axis=1, keepdims=True))


def best_of_six(hypotheses: Hypotheses, truth: Floats) -> Flags:
    """Which of the six hypotheses is the best, the first of equal ones; one True per row, ``(N, min(k, 6))``."""
    end = distances(hypotheses.xy_m[:, :BEST_OF, -1:], truth[:, -1:])[..., 0]
    return np.asarray(np.arange(end.shape[1]) == end.argmin(axis=1)[:, None])


BINS: Final = 10
"""Number of bins of equal width over probabilities from 0 to 1."""


def reliability_of(hypotheses: Hypotheses, truth: Floats) -> Floats:
    """Count the six most probable hypotheses of each sample by probability bin, shape ``(3, BINS)``.

    The rows are the hypotheses in each bin, the sum of their probabilities, and how many were the best of their sample;
    counts of several episodes add up. A single hypothesis is no statement and not counted, nor are hypotheses of
    probability 0, which fill up samples with fewer ones.
    """
    probability = probability_of_six(hypotheses)
    if probability.shape[1] < 2:
        return np.zeros((3, BINS))
    counted = probability > 0.0
    stated, best = probability[counted], best_of_six(hypotheses, truth)[counted]
    place = np.minimum((stated * BINS).astype(np.intp), BINS - 1)
    weights = np.ones(len(stated)), stated, best.astype(np.float64)
    return np.array([np.bincount(place, weights=row, minlength=BINS) for row in weights], dtype=np.float64)


def calibration_error(reliability: Floats) -> MetricValue:
    """Mean difference between stated probability and observed frequency, weighted by the bins' counts.

    The "expected calibration error" of M. Naeini, G. Cooper, M. Hauskrecht, AAAI 2015.
    """
    count, probability, best = reliability
    total = float(count.sum())
    return MetricValue(float(np.abs(probability - best).sum() / total) if total else None, int(total))


MISS_M: Final = 2.0
"""Distance of a miss, Argoverse 2's threshold."""


def missed_6(hypotheses: Hypotheses, truth: Floats) -> Floats:
    """1 where each of the six most probable hypotheses ends more than 2 m from the truth, else 0; shape ``(N,)``."""
    return np.asarray(min_fde_6(hypotheses, truth) > MISS_M, dtype=np.float64)


def colliding(hypotheses: Hypotheses, batch: SampleBatch) -> Floats:
    """1 where the footprint on the most probable path overlaps that of another sample of the same frame, else 0.

    Both footprints are at the same time, any of the grid's. A footprint points along its path, and keeps its heading
    where the vehicle stands.

    Returns:
        Shape ``(N,)``; NaN where the frame has no other sample.
    """
    path = hypotheses.xy_m[:, 0]
    heading = _headings(path, batch)
    target = batch.target
    frame = batch.actors.frame[target]
    first, count = np.unique(frame, return_index=True, return_counts=True)[1:]
    hit = np.zeros(len(path))
    sizes = 0.5 * np.stack((batch.actors.length_m[target], batch.actors.width_m[target]))
    _mark(path, np.cos(heading), np.sin(heading), sizes, first, first + count, hit)
    return np.where(np.repeat(count, count) > 1, hit, np.nan) if len(hit) else hit


def _headings(path: Floats, batch: SampleBatch) -> Floats:
    """Heading at each point, shape ``(N, T)``: that of the segment before it.

    A short segment keeps the last heading.
    """
    legs = np.diff(np.concatenate((batch.xy_m[:, None], path), axis=1), axis=1)
    moves = np.hypot(legs[..., 0], legs[..., 1]) > _STILL_M
    heading = np.arctan2(legs[..., 1], legs[..., 0])
    before = batch.yaw_rad
    for point in range(path.shape[1]):
        before = np.where(moves[:, point], heading[:, point], before)
        heading[:, point] = before
    return heading


_LENGTH, _WIDTH = range(2)
"""Rows of sizes."""


@compiled
def _mark(path: Floats, cos: Floats, sin: Floats, half: Floats, first: Rows, end: Rows, hit: Floats) -> None:
    """Set ``hit`` to 1 for samples whose box overlaps that of another sample of their frame."""
    for frame in range(len(first)):
        for a in range(first[frame], end[frame]):
            for b in range(a + 1, end[frame]):
                if hit[a] > 0.0 and hit[b] > 0.0:
                    continue
                reach = np.hypot(half[_LENGTH, a], half[_WIDTH, a]) + np.hypot(half[_LENGTH, b], half[_WIDTH, b])
                for t in range(path.shape[1]):
                    dx, dy = path[b, t, X] - path[a, t, X], path[b, t, Y] - path[a, t, Y]
                    if dx * dx + dy * dy >= reach * reach:
                        continue
                    first_box = (path[a, t, X], path[a, t, Y], cos[a, t], sin[a, t])
                    second_box = (path[b, t, X], path[b, t, Y], cos[b, t], sin[b, t])
                    if (
                        box_gap_m(
                            first_box, second_box, half[_LENGTH, a], half[_WIDTH, a], half[_LENGTH, b], half[_WIDTH, b]
                        )
                        < 0.0
                    ):
                        hit[a] = hit[b] = 1.0
                        break


def _by_truth(function: Callable[[Hypotheses, Floats], Floats]) -> Callable[[Hypotheses, ScoredSamples], Floats]:
    return lambda hypotheses, samples: function(hypotheses, samples.future_xy_m)


ACCELERATION_MAX_MPS2: Final = 0.9 * 9.81
"""Largest total acceleration: tyres on dry asphalt carry 0.8 to 0.9 g (J. Y. Wong, Theory of Ground Vehicles, ch.
1)."""
RADIUS_MIN_M: Final = 6.4
"""Smallest radius of the centre's path: design passenger car (AASHTO, Green Book 2018, table 2-2)."""
_TURNING_MIN_MPS: Final = 1.0
"""Bends are checked only above this speed; below it the direction of a segment is not certain enough."""
_POINT_S: Final = FRAME_PERIOD_S * FUTURE_STRIDE_FRAMES


def infeasible(hypotheses: Hypotheses, samples: ScoredSamples) -> Floats:
    """1 where the most probable path exceeds a limit of acceleration or curvature, else 0; shape ``(N,)``.

    The path begins with the vehicle's recorded velocity.
    """
    batch = samples.batch
    places = np.concatenate((batch.xy_m[:, None], hypotheses.xy_m[:, 0]), axis=1)
    velocity = np.diff(places, axis=1) / _POINT_S
    # The velocity of a segment belongs to its middle, so the first change takes half a period.
    gained = np.diff(np.concatenate((batch.velocity_mps[:, None], velocity), axis=1), axis=1)
    gained[:, 0] *= 2.0
    acceleration = np.hypot(gained[..., 0], gained[..., 1]) / _POINT_S
    speed = np.hypot(velocity[..., 0], velocity[..., 1])
    turned = np.abs(wrap_angle(np.diff(np.arctan2(velocity[..., 1], velocity[..., 0]), axis=1)))
    way = 0.5 * (speed[:, 1:] + speed[:, :-1]) * _POINT_S
    moves = np.minimum(speed[:, 1:], speed[:, :-1]) > _TURNING_MIN_MPS
    bent = moves & (turned * RADIUS_MIN_M > way)
    return ((acceleration > ACCELERATION_MAX_MPS2).any(axis=1) | bent.any(axis=1)).astype(np.float64)


WORLDS: Final = 6
"""Number of worlds in Argoverse 2's multi-world metrics."""


def world_min_ade_6(hypotheses: Hypotheses, samples: ScoredSamples) -> Floats:
    """Error of the best of six worlds: mean distance over a frame's vehicles and over time, in metres."""
    return _of_frames(_distances(hypotheses, samples).mean(axis=-1), samples)


def world_min_fde_6(hypotheses: Hypotheses, samples: ScoredSamples) -> Floats:
    """Error of the best of six worlds: mean distance over a frame's vehicles at the horizon, in metres."""
    return _of_frames(_distances(hypotheses, samples)[..., -1], samples)


def _distances(hypotheses: Hypotheses, samples: ScoredSamples) -> Floats:
    miss = hypotheses.xy_m[:, :WORLDS] - samples.future_xy_m[:, None]
    return np.asarray(np.hypot(miss[..., 0], miss[..., 1]))


def _of_frames(errors: Floats, samples: ScoredSamples) -> Floats:
    """Put the error of the best world at the first sample of each frame and NaN at the others: a frame counts once.

    Errors have the shape ``(N, k)``, the answer ``(N,)``.
    """
    frame = samples.batch.actors.frame[samples.batch.target]
    values = np.full(len(errors), np.nan)
    if len(errors):
        first, count = np.unique(frame, return_index=True, return_counts=True)[1:]
        values[first] = (np.add.reduceat(errors, first, axis=0) / count[:, None]).min(axis=1)
    return values


SCENE_METRICS: Final = (
    Metric("world_min_ade_6_m", "world minADE6", world_min_ade_6, of_frames=True),
    Metric("world_min_fde_6_m", "world minFDE6", world_min_fde_6, of_frames=True),
    Metric("off_road_rate", "off road", off_road),
    Metric("wrong_way_rate", "wrong way", wrong_way),
    Metric("infeasible_rate", "infeasible", infeasible),
)
"""Metrics of whole frames, of the road, and of a vehicle's limits."""
METRICS: Final = (
    Metric("ade_m", "ADE", _by_truth(ade)),
    Metric("fde_m", "FDE", _by_truth(fde)),
    Metric("min_ade_6_m", "minADE6", _by_truth(min_ade_6)),
    Metric("min_fde_6_m", "minFDE6", _by_truth(min_fde_6)),
    Metric("rmse_5s_m", "RMSE@5s", _by_truth(squared_fde), np.sqrt),
    Metric("miss_rate_6", "MR6", _by_truth(missed_6)),
    Metric("brier_min_fde_6_m", "b-minFDE6", _by_truth(brier_min_fde_6)),
    Metric("brier_score", "Brier", _by_truth(brier_score)),
    Metric("path_collision_rate", "collisions", lambda hypotheses, samples: colliding(hypotheses, samples.batch)),
    *SCENE_METRICS,
)
"""Every metric of the evaluation, in the order of reports."""
METRIC_OF: Final = {metric.name: metric for metric in METRICS}
"""Metrics by name."""
