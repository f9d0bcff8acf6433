"""Finds paths ahead of each sample along the road network, with their stop lines.

An observer does not know which lane a vehicle drives along: the lanes come from its pose alone.
"""

from dataclasses import dataclass, field
from typing import Final

import numpy as np

from siren_ros.base.numerics.arrays import Flags, Floats, Points, Rows
from siren_ros.base.numerics.geometry import Polyline, wrap_angle
from siren_ros.simulation.roads.road_network import Connection, LaneKind, RoadNetwork
from siren_ros.simulation.world.actors import Indices

_DRIVEN_KINDS: Final = frozenset({LaneKind.DRIVING, LaneKind.SHOULDER, LaneKind.INTERNAL})
_MARGIN_M: Final = 1.5
"""A lane is a candidate up to this far outside its edge, because pulled-over vehicles stand there."""
_END_MARGIN_M: Final = 0.5
_TURNED_MAX_RAD: Final = np.pi / 3.0
_OFFSET_COST_PER_M: Final = 1.0
_HEADING_COST_PER_RAD: Final = 3.0


@dataclass(frozen=True)
class LaneCandidates:
    """C pairs of a vehicle and a lane that it may use, sorted by vehicle; arrays of shape ``(C,)``."""

    row: Rows
    """Index of the vehicle's pose."""
    lane: Indices
    arc_m: Floats
    """Arc length of the footprint's centre along the lane."""
    offset_m: Floats
    """Distance of the centre from the lane's centre line, positive to the left."""
    turned_rad: Floats
    """Heading of the vehicle minus that of the lane."""
    cost: Floats
    """Cost that grows with offset and angle; the likeliest lane has the lowest."""


def lane_candidates(network: RoadNetwork, xy_m: Floats, yaw_rad: Floats) -> LaneCandidates:
    """Find all lanes that contain a pose or pass near it, with a direction within 60° of its heading.

    Poses are footprint centres, shape ``(M, 2)``, and headings, shape ``(M,)``.
    """
    nothing = np.empty(0)
    parts = [(np.empty(0, dtype=np.intp), np.empty(0, dtype=np.int32), nothing, nothing, nothing)]
    low, high = xy_m.min(axis=0, initial=np.inf), xy_m.max(axis=0, initial=-np.inf)
    for lane in network.lanes:
        reach = 0.5 * lane.width_m + _MARGIN_M
        corner_low, corner_high = lane.centre.points.min(axis=0) - reach, lane.centre.points.max(axis=0) + reach
        if lane.kind not in _DRIVEN_KINDS or (corner_low > high).any() or (corner_high < low).any():
            continue
        near = np.flatnonzero(((xy_m >= corner_low) & (xy_m <= corner_high)).all(axis=1))
        if len(near) == 0:
            continue
        arc, left = lane.centre.project(xy_m[near])
        turned = wrap_angle(yaw_rad[near] - lane.centre.heading_rad(arc))
        fits = (np.abs(left) <= reach) & (np.abs(turned) <= _TURNED_MAX_RAD)
        fits &= (arc >= -_END_MARGIN_M) & (arc <= lane.length_m + _END_MARGIN_M)
        lanes = np.full(len(near), lane.index, dtype=np.int32)
        parts.append((near[fits], lanes[fits], arc[fits], left[fits], turned[fits]))
    row, lane_of, arc, left, turned = (np.concatenate(part) for part in zip(*parts, strict=True))
    cost = _OFFSET_COST_PER_M * np.abs(left) + _HEADING_COST_PER_RAD * np.abs(turned)
    order = np.lexsort((cost, row))
    return LaneCandidates(row[order], lane_of[order], arc[order], left[order], turned[order], cost[order])


PATHS_PER_LANE: Final = 4
"""Number of paths that are kept per lane, the straightest ones."""
_WAYS_MAX: Final = 64
"""Limit of the search, for networks with very short lanes."""


@dataclass(frozen=True)
class StopLine:
    """Point where a path enters a junction, and its movement there."""

    arc_m: float
    """Distance along the path."""
    movement: Connection


@dataclass(frozen=True)
class RoadPath:
    """One path along consecutive lanes."""

    curve: Polyline
    stop_lines: tuple[StopLine, ...]
    turn_rad: float
    """Sum of the absolute turning angles at junctions."""
    first_lane: int


@dataclass
class _Way:
    lanes: list[int]
    end_m: float
    stop_lines: list[StopLine] = field(default_factory=list)
    turn_rad: float = 0.0


@dataclass(frozen=True)
class RoadPaths:
    """Finds and caches the paths of one road network."""

    network: RoadNetwork

    def ahead(self, lane: int, reach_m: float) -> tuple[RoadPath, ...]:
        """Find the straightest paths from a lane's start, straightest first; at least one.

        Args:
            lane: Index of the lane; may be a path across a junction.
            reach_m: How far they go beyond the lane's end, as far as lanes follow.
        """
        length = self.network.lanes[lane].length_m
        open_ways = [_Way([lane], length)]
        done: list[_Way] = []
        while open_ways:
            way = open_ways.pop()
            following = self._followings(way) if way.end_m < length + reach_m else []
            if following and len(open_ways) + len(done) < _WAYS_MAX:
                open_ways.extend(following)
            else:
                done.append(way)
        done.sort(key=lambda way: (round(way.turn_rad, 3), way.lanes))
        paths = []
        for way in done[:PATHS_PER_LANE]:
            curve = Polyline.joined([self.network.lanes[index].centre for index in way.lanes])
            paths.append(RoadPath(curve, tuple(way.stop_lines), way.turn_rad, lane))
        return tuple(paths)

    def _followings(self, way: _Way) -> list[_Way]:
        last = way.lanes[-1]
        network = self.network
        if network.lanes[last].kind is LaneKind.INTERNAL:
            movements = network.connections_over.get(last, ())
            parts = [(movement.via[movement.via.index(last) + 1 :], movement) for movement in movements]
            return [self._longer(way, (*via, movement.to_lane), ()) for via, movement in parts]
        return [
            self._longer(way, (*movement.via, movement.to_lane), (StopLine(way.end_m, movement),))
            for movement in network.connections_from.get(last, ())
        ]

    def _longer(self, way: _Way, added: tuple[int, ...], stop_lines: tuple[StopLine, ...]) -> _Way:
        lanes = self.network.lanes
        before = lanes[way.lanes[-1]].centre
        turn = wrap_angle(lanes[added[-1]].centre.heading_rad(0.0) - before.heading_rad(before.length_m))
        return _Way(
            [*way.lanes, *added],
            way.end_m + float(np.sum([lanes[index].length_m for index in added])),
            [*way.stop_lines, *stop_lines],
            way.turn_rad + abs(float(turn)),
        )


PATHS: Final = 4
"""Maximum number of paths of a sample."""
PATH_POINTS: Final = 32
_LANES: Final = 3
"""Maximum number of lanes that a vehicle may use."""
_REACHES_M: Final = np.array([0.0, 15.0, 30.0, 50.0, 75.0, 120.0])
"""Paths are searched to one of these distances beyond the lane's end, so that vehicles can share them."""
_TURN_COST_PER_RAD: Final = 0.7
_HORIZON_S: Final = 6.0
_STANDING_REACH_M: Final = 30.0
_REACH_MAX_M: Final = 120.0


@dataclass(frozen=True)
class PathChoice:
    """Up to ``PATHS`` paths for each of N samples, likeliest first.

    A path begins at the sample's place and keeps its offset from the centre line of the lane, so that a vehicle that
    follows it does not jump.
    """

    known: tuple[RoadPath, ...]
    """All paths that some sample uses."""
    index: Rows
    """Index into ``known``, −1 for an empty place; shape ``(N, PATHS)``."""
    arc_m: Floats
    """Arc length of the sample's centre on the path, shape ``(N, PATHS)``."""
    offset_m: Floats
    """Distance of the centre from the path's centre line, positive to the left; shape ``(N, PATHS)``."""
    turned_rad: Floats
    """Heading of the vehicle minus that of the lane, shape ``(N, PATHS)``."""
    spacing_m: Floats
    """Distance between consecutive points, shape ``(N,)``; it grows with speed, so that fast vehicles see more of the
    road."""

    @property
    def there(self) -> Flags:
        """Whether a place has a path, shape ``(N, PATHS)``."""
        return self.index >= 0

    def points(self) -> Points:
        """Points along the paths in the frame ``map``, 0 for empty places; ``(N, PATHS, PATH_POINTS, 2)``."""
        points = np.zeros((*self.index.shape, PATH_POINTS, 2))
        steps = np.arange(PATH_POINTS)
        for path, row, column in self.groups():
            arc = self.arc_m[row, column, None] + self.spacing_m[row, None] * steps
            points[row, column] = path.curve.offset_points(arc, self.offset_m[row, column, None])
        return points

    def groups(self) -> list[tuple[RoadPath, Rows, Rows]]:
        """Each used path, with the samples and columns that use it."""
        row, column = np.nonzero(self.there)
        index = self.index[row, column]
        order = np.argsort(index, kind="stable")
        row, column = row[order], column[order]
        counts = np.bincount(index, minlength=len(self.known))
        ends = np.cumsum(counts)
        return [
            (path, row[start:end], column[start:end])
            for path, start, end in zip(self.known, (ends - counts).tolist(), ends.tolist(), strict=True)
        ]


def choose_paths(network: RoadNetwork, xy_m: Floats, yaw_rad: Floats, speed_mps: Floats) -> PathChoice:
    """Choose the likeliest paths of N vehicles by their footprint centres: small offset, small angle, few turns."""
    count = len(xy_m)
    reach = np.minimum(_HORIZON_S * speed_mps + _STANDING_REACH_M, _REACH_MAX_M)
    candidates = lane_candidates(network, xy_m, yaw_rad)
    kept = np.flatnonzero(rank_within(candidates.row) < _LANES)
    row, lane, arc = candidates.row[kept], candidates.lane[kept], candidates.arc_m[kept]
    lengths = np.array([road_lane.length_m for road_lane in network.lanes])
    beyond = arc + reach[row] - lengths[lane]
    step = np.searchsorted(_REACHES_M, np.minimum(beyond, _REACHES_M[-1]))
    roads, pairs = RoadPaths(network), []
    known: list[RoadPath] = []
    for code in np.unique(lane.astype(np.int64) * len(_REACHES_M) + step).tolist():
        first, steps = divmod(code, len(_REACHES_M))
        members = np.flatnonzero((lane == first) & (step == steps))
        for path in roads.ahead(first, float(_REACHES_M[steps])):
            pairs.append((members, np.full(len(members), len(known)), np.full(len(members), path.turn_rad)))
            known.append(path)
    shape = (count, PATHS)
    choice = PathChoice(
        known=tuple(known),
        index=np.full(shape, -1, dtype=np.intp),
        arc_m=np.zeros(shape),
        offset_m=np.zeros(shape),
        turned_rad=np.zeros(shape),
        spacing_m=reach / (PATH_POINTS - 1),
    )
    if pairs:
        member, path_index, turn = (np.concatenate(parts) for parts in zip(*pairs, strict=True))
        # Costs are rounded, so that the order of equal costs does not depend on the scene's position.
        cost = np.round(candidates.cost[kept][member] + _TURN_COST_PER_RAD * turn, 3)
        order = np.lexsort((path_index, cost, row[member]))
        member, path_index = member[order], path_index[order]
        place = rank_within(row[member])
        few = place < PATHS
        member, path_index, at = member[few], path_index[few], (row[member[few]], place[few])
        choice.index[at], choice.arc_m[at] = path_index, arc[member]
        chosen = kept[member]
        choice.offset_m[at], choice.turned_rad[at] = candidates.offset_m[chosen], candidates.turned_rad[chosen]
    return choice


def rank_within(group: Rows) -> Rows:
    """Rank of each element in its group; groups are in increasing order."""
    return np.arange(len(group)) - np.searchsorted(group, group)
