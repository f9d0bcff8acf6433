"""Measures the corridor ahead of the EMV every half second: how wide a path through the traffic is."""

from dataclasses import dataclass
from typing import Final

import numpy as np

from siren_ros.base.numerics.arrays import Flags, Floats
from siren_ros.base.numerics.compiled import Array, compiled
from siren_ros.base.numerics.geometry import wrap_angle
from siren_ros.base.tables.interval import Measure
from siren_ros.data.recording.episode_record import EpisodeRecord, Steps
from siren_ros.scoring.evaluation.yielding.encounters import EmvLine, OnLine, YieldThresholds
from siren_ros.simulation.roads.road_network import LaneKind, RoadNetwork

EVERY_STEPS: Final = 10
_CELL_M: Final = 0.1
_REACH_M: Final = 10.0
"""Lateral range of the search on each side of the line."""
_SLOPE: Final = 0.3
"""Largest lateral shift per metre, which a vehicle can follow at low speed."""
_START_M: Final = 0.3
"""The path begins within this distance of the EMV."""
_USED: Final = (LaneKind.DRIVING, LaneKind.SHOULDER, LaneKind.INTERNAL)
_SEAM_M: Final = 0.1
"""Tolerance for rounding gaps between neighbouring lanes."""
_ALIGNED_RAD: Final = np.pi / 4.0
_ACROSS_M: Final = np.arange(-_REACH_M, _REACH_M + 0.5 * _CELL_M, _CELL_M)


@dataclass(frozen=True)
class CorridorSeries:
    """The corridor over time; arrays of shape ``(K,)``."""

    step: Steps
    width_m: Floats
    """Width of the widest path through the traffic over the look-ahead, at its narrowest place."""
    contested: Flags
    """Whether other vehicles are on that part of the road; an empty road has no corridor."""
    needed_m: float
    """Width that the EMV needs: its own and the margins."""

    @property
    def passable(self) -> Flags:
        """Whether the EMV fits through."""
        return np.asarray(self.width_m >= self.needed_m)


def corridor_series(record: EpisodeRecord, line: EmvLine, limits: YieldThresholds) -> CorridorSeries:
    """Compute the corridor at every half second for which the line covers the whole look-ahead."""
    others = [line.place(record, actor) for actor in record.actors if actor not in record.emv_ids]
    sizes = {actor_id: (actor.length_m, actor.width_m) for actor_id, actor in record.actors.items()}
    stations = np.arange(0.0, limits.look_ahead_m + 0.5, 1.0)
    road = road_cells(record.network, line, np.arange(0.0, line.line.length_m + 1.0, 1.0))
    steps, widths, contested = [], [], []
    for row in range(0, len(line.emv.track), EVERY_STEPS):
        arc = float(line.emv.arc_m[row]) + 0.5 * line.length_m + stations
        if arc[-1] > line.line.length_m:
            continue
        step = int(line.emv.track.step[row])
        free = road[np.minimum(np.round(arc).astype(np.intp), len(road) - 1)]
        occupied = np.zeros_like(free)
        for other in others:
            at = int(np.searchsorted(other.track.step, step))
            if at == len(other.track) or other.track.step[at] != step:
                continue
            size_m = sizes[int(other.track.actor_id[at])]
            reach_m = sum(size_m) + 0.5
            if arc[0] - reach_m < other.arc_m[at] < arc[-1] + reach_m:
                occupied |= covered_cells(other, at, size_m, arc)
        steps.append(step)
        contested.append(bool((occupied & free).any()))
        widths.append(widest_way_m(free & ~occupied, float(line.emv.left_m[row])))
    columns = np.array(steps, dtype=np.int64), np.array(widths), np.array(contested, dtype=np.bool_)
    return CorridorSeries(*columns, needed_m=line.width_m + 2.0 * limits.corridor_margin_m)


def widest_way_m(free: Flags, start_m: float) -> float:
    """Width of the widest path through all stations, at its narrowest place.

    Args:
        free: Whether a place is free, shape ``(S, C)``: stations of 1 m ahead, cells of 0.1 m across.
        start_m: Where the way begins across the line.
    """
    # For each cell: twice the lateral distance to the nearest cell that is not free.
    cells = np.arange(free.shape[1])
    left = cells - np.maximum.accumulate(np.where(free, -1, cells), axis=1)
    right = np.minimum.accumulate(np.where(free, free.shape[1], cells)[:, ::-1], axis=1)[:, ::-1] - cells
    width = (2 * np.minimum(left, right) - 1).clip(0) * _CELL_M
    best = np.where(np.abs(_ACROSS_M - start_m) <= _START_M, width[0], 0.0)
    return float(_follow(best, width, round(_SLOPE / _CELL_M)).max())


@compiled
def _follow(best: Array, width: Array, reach: int) -> Array:
    """Widest path to each cell of the last station; between stations it shifts by at most ``reach`` cells."""
    for station in range(1, len(width)):
        before = best.copy()
        for cell in range(len(best)):
            best[cell] = min(before[max(cell - reach, 0) : cell + reach + 1].max(), width[station, cell])
    return best


def covered_cells(other: OnLine, row: int, size_m: tuple[float, float], arc_m: Floats) -> Flags:
    """Cells beside the line that a vehicle's body covers at one state of its track, shape ``(S, C)``.

    The body is half a metre longer at each end, because stations are 1 m apart.

    Args:
        other: The vehicle's places on the line.
        row: The state.
        size_m: Length and width.
        arc_m: Stations on the line, shape ``(S,)``.
    """
    along = arc_m[:, None] - other.arc_m[row]
    across = _ACROSS_M - other.left_m[row]
    cos, sin = np.cos(other.turn_rad[row]), np.sin(other.turn_rad[row])
    inside = np.abs(along * cos + across * sin) <= 0.5 * size_m[0] + 0.5
    return np.asarray(inside & (np.abs(across * cos - along * sin) <= 0.5 * size_m[1]))


def road_cells(network: RoadNetwork, line: EmvLine, arc_m: Floats) -> Flags:
    """Road surface in the line's direction, including shoulders, at places on the line, shape ``(S, C)``.

    Lanes belong to it as far as one borders on the next, from the line outwards; a road of its own next to it does not.
    """
    points, heading = line.line.at(arc_m), line.line.heading_rad(arc_m)
    cells = np.zeros((len(arc_m), len(_ACROSS_M)), dtype=np.bool_)
    for lane in network.lanes:
        if lane.kind not in _USED:
            continue
        low, high = lane.centre.points.min(axis=0) - _REACH_M, lane.centre.points.max(axis=0) + _REACH_M
        near = np.flatnonzero(((points >= low) & (points <= high)).all(axis=1))
        if not len(near):
            continue
        s, left = lane.centre.project(points[near])
        along = (s >= -0.5) & (s <= lane.length_m + 0.5) & (np.abs(left) <= _REACH_M)
        along &= np.abs(wrap_angle(lane.centre.heading_rad(s) - heading[near])) < _ALIGNED_RAD
        cells[near[along]] |= np.abs(_ACROSS_M + left[along, None]) <= 0.5 * lane.width_m + _SEAM_M
    middle = np.argmin(np.where(cells, np.abs(_ACROSS_M), np.inf), axis=1)
    for row, start in enumerate(middle.tolist()):
        gaps = np.flatnonzero(~cells[row])
        place = int(np.searchsorted(gaps, start))
        cells[row, : gaps[place - 1] if place else 0] = False
        cells[row, gaps[place] if place < len(gaps) else len(_ACROSS_M) :] = False
    return cells


def corridor_width_m(series: CorridorSeries) -> Measure:
    """Median width of the corridor while other vehicles are ahead."""
    if not series.contested.any():
        return Measure.lacking("nobody was ahead of the EMV")
    return Measure(float(np.median(series.width_m[series.contested])))


def corridor_continuity(series: CorridorSeries) -> Measure:
    """Share of the time with vehicles ahead in which the EMV fits through the whole look-ahead."""
    if not series.contested.any():
        return Measure.lacking("nobody was ahead of the EMV")
    return Measure(float(series.passable[series.contested].mean()))
