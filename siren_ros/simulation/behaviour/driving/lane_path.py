"""Reference lines along the lanes of a route, through junctions, and where one vehicle stands on a lane.

The shoulder is an EMV's way where it leads into the next right turn; the other vehicles leave it free. A line that
begins with a lateral jump moves sideways gently instead, as drivers do.
"""

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Final
from weakref import WeakKeyDictionary

import numpy as np

from siren_ros.base.numerics.arrays import Floats, Points
from siren_ros.base.numerics.compiled import X, Y, compiled
from siren_ros.base.numerics.geometry import Polyline, wrap_angle
from siren_ros.simulation.behaviour.driving.tracked_path import SMOOTHING_M, Curve, LaneEnd, LanePath
from siren_ros.simulation.roads.road_network import NO_LANE, Connection, LaneKind, RoadNetwork
from siren_ros.simulation.roads.routing import is_plain_joint, movement_turn_rad
from siren_ros.simulation.world.actors import Indices

# These are no parameters: they limit the search along a route; no behaviour depends on them.
_EDGES_AHEAD: Final = 8
"""Number of edges of a route that the choice of lanes considers."""
_FAR: Final = 99
_SAME_TURN_RAD: Final = 0.35
"""Movements whose turns differ by less than this (about 20°) are equally straight."""
_LIMITS_KEPT: Final = 1024
"""Number of lanes whose road's limits are cached."""


SHOULDER_REACH_M: Final = 160.0
"""Distance beyond the present edge within which a right turn lets the EMV use the shoulder that leads into it."""


def changes_needed(network: RoadNetwork, route: Indices, civilian: bool) -> list[dict[int, int]]:
    """Number of lane changes that each lane of the route's next edges needs to follow the route.

    Returns:
        For each of the first edges a mapping from lane index to the number of changes; lanes from which the route
        cannot be followed at all are missing.
    """
    known, key = _CHANGES.setdefault(network, {}), (tuple(route[:_EDGES_AHEAD].tolist()), civilian)
    if key not in known:
        known[key] = _changes_needed(network, *key)
    return known[key]


_CHANGES: Final[WeakKeyDictionary[RoadNetwork, dict[tuple[tuple[int, ...], bool], list[dict[int, int]]]]] = (
    WeakKeyDictionary()
)
"""Cache of pure results."""


def _changes_needed(network: RoadNetwork, route: tuple[int, ...], civilian: bool) -> list[dict[int, int]]:
    needed: list[dict[int, int]] = []
    for edge in reversed(route):
        road = (network.lanes[lane] for lane in network.edges[edge].lanes)
        position = {
            lane.index: lane.position
            for lane in road
            if (lane.civilian_allowed if civilian else lane.emergency_allowed)
        }
        straight_on = dict.fromkeys(position, 0)
        if needed:
            ways = {lane: [c.to_lane for c in network.connections_from.get(lane, ())] for lane in position}
            ways = {lane: [ahead for ahead in targets if ahead in needed[-1]] for lane, targets in ways.items()}
            straight_on = {
                lane: min(needed[-1][ahead] for ahead in targets) for lane, targets in ways.items() if targets
            }
        changes = {
            lane: min(cost + abs(position[lane] - position[other]) for other, cost in straight_on.items())
            for lane in position
            if straight_on
        }
        needed.append(changes)
    return needed[::-1]


def connection_along(
    network: RoadNetwork, lane: int, next_edge: int, needed_after: dict[int, int]
) -> Connection | None:
    """Movement from a lane to the next edge that needs the fewest lane changes afterwards.

    Of equals it is the straightest, where a lane fans out into several, and then the one to the rightmost lane.
    """
    lanes = network.lanes

    def effort(choice: Connection) -> tuple[int, int, int]:
        changes = needed_after.get(choice.to_lane, _FAR)
        return changes, round(movement_turn_rad(network, choice) / _SAME_TURN_RAD), lanes[choice.to_lane].position

    choices = [c for c in network.connections_from.get(lane, ()) if lanes[c.to_lane].edge == next_edge]
    return min(choices, key=effort) if len(choices) > 1 else next(iter(choices), None)


def connection_of_internal(network: RoadNetwork, lane: int, route: Indices) -> Connection | None:
    """Movement that an internal lane belongs to; if several share it, the one along the route."""
    edges = set(route[:3].tolist())
    movements = network.connections_over.get(lane, ())
    along = (movement for movement in movements if network.lanes[movement.to_lane].edge in edges)
    return next(along, movements[0] if movements else None)


def lanes_along(
    network: RoadNetwork,
    lane: int,
    position_m: float,
    route: Indices,
    ahead_m: float,
    civilian: bool = False,
    through_junctions: bool = True,
) -> tuple[tuple[int, ...], LaneEnd]:
    """Lanes along a route from a position on a lane, which may be internal, for ``ahead_m``.

    The route has the edges from the present one (or the one before the junction, or the one that follows) on. With
    ``civilian``, only lanes open to civilians are used; ``through_junctions`` says whether to go on beyond joints that
    are more than two pieces of one road.
    """
    lanes = [lane]
    left = network.lanes[lane].length_m - position_m
    edges, needed = route.tolist(), changes_needed(network, route, civilian)
    if network.edges[network.lanes[lane].edge].internal:
        inside = connection_of_internal(network, lane, route)
        if inside is None:
            return tuple(lanes), LaneEnd.ASTRAY
        rest = (*inside.via[inside.via.index(lane) + 1 :], inside.to_lane)
        lanes.extend(rest)
        left += network.length_m(rest)
    while left < ahead_m:
        present = network.lanes[lanes[-1]].edge
        step = edges.index(present) + 1 if present in edges else 0  # the front is already on the next edge
        if step >= len(edges):
            return tuple(lanes), LaneEnd.ROUTE
        edges, needed = edges[step:], needed[step:]
        connection = connection_along(network, lanes[-1], edges[0], needed[0] if needed else {})
        if connection is None:
            return tuple(lanes), LaneEnd.ASTRAY
        if not through_junctions and not is_plain_joint(network, connection):
            return tuple(lanes), LaneEnd.JUNCTION
        rest = (*connection.via, connection.to_lane)
        lanes.extend(rest)
        left += network.length_m(rest)
    return tuple(lanes), LaneEnd.HORIZON


def path_on_lanes(
    network: RoadNetwork, lanes: tuple[int, ...], end: LaneEnd, from_m: float, ahead_m: float
) -> LanePath:
    """The smoothed reference line along consecutive lanes, at most ``ahead_m`` long.

    It begins at ``from_m`` on the first lane; a negative value extends it straight backwards.
    """
    whole, starts = _joined(tuple(network.lanes[lane].centre for lane in lanes))
    to_m = max(min(whole.length_m, from_m + ahead_m), from_m + 2.0)
    curve = Curve.through(whole.cut(from_m, to_m).points, SMOOTHING_M)
    scale = curve.length_m / (to_m - from_m)
    reached = to_m >= whole.length_m - 1e-6
    return LanePath(lanes, (starts - from_m) * scale, curve, end if reached else LaneEnd.HORIZON)


@lru_cache(maxsize=256)
def _joined(parts: tuple[Polyline, ...]) -> tuple[Polyline, Floats]:
    """Centre lines of consecutive lanes as one curve, and where each begins on it."""
    whole = Polyline.joined(parts)
    lengths = np.array([part.length_m for part in parts])
    starts = np.concatenate(([0.0], np.cumsum(lengths)[:-1])) * (whole.length_m / max(lengths.sum(), 1e-6))
    return without_jumps(whole, starts)


def neighbour_lane(network: RoadNetwork, lane: int, side: int) -> int:
    """Index of the neighbouring lane (+1 left, −1 right); ``NO_LANE`` if there is none."""
    beside = network.neighbour(network.lanes[lane], side)
    return NO_LANE if beside is None else beside.index


@dataclass(frozen=True)
class RoadLimits:
    """Edges of the road relative to a lane's centre line, positive to the left."""

    right_m: float
    """Right edge of all lanes that an EMV may use."""
    driving_right_m: float
    """Right edge of the road without its shoulder."""
    left_m: float
    opposite_m: float
    """Width of the nearest opposite lane; 0 if there is none."""
    opposite_road_m: float
    """Width of all opposite driving lanes."""


@lru_cache(maxsize=_LIMITS_KEPT)
def road_limits(network: RoadNetwork, lane: int) -> RoadLimits:
    """How far the road reaches on both sides of a lane."""
    here = network.lanes[lane]
    edge = network.edges[here.edge]
    lanes = [network.lanes[item] for item in edge.lanes if network.lanes[item].emergency_allowed]
    right = -0.5 * here.width_m - sum(item.width_m for item in lanes if item.position < here.position)
    left = 0.5 * here.width_m + sum(item.width_m for item in lanes if item.position > here.position)
    ends = (edge.to_junction, edge.from_junction)
    back = (other for other in network.edges if (other.from_junction, other.to_junction) == ends and not other.internal)
    lanes_back = () if edge.internal else next((other.lanes for other in back), ())
    opposite = [network.lanes[item].width_m for item in lanes_back if network.lanes[item].kind is LaneKind.DRIVING]
    shoulders = sum(item.width_m for item in lanes if item.kind is LaneKind.SHOULDER)
    return RoadLimits(right, right + shoulders, left, opposite[-1] if opposite else 0.0, sum(opposite))


def nearest_on_lane(centre: Polyline, x_m: float, y_m: float) -> tuple[float, float, float]:
    """Arc length, offset (positive to the left) and heading at the place of a centre line nearest to a point.

    The first and last segments are extended straight on, as by ``Polyline.project``.
    """
    return nearest_on_line(centre.points, centre.arc_m, x_m, y_m)


@compiled
def nearest_on_line(points: Points, arc_m: Floats, x_m: float, y_m: float) -> tuple[float, float, float]:
    """``nearest_on_lane`` for compiled loops."""
    last, least = len(points) - 2, np.inf
    s_m, left_m, heading_x, heading_y = 0.0, 0.0, 1.0, 0.0
    for i in range(last + 1):
        length = arc_m[i + 1] - arc_m[i]
        along_x, along_y = (points[i + 1, X] - points[i, X]) / length, (points[i + 1, Y] - points[i, Y]) / length
        dx, dy = x_m - points[i, X], y_m - points[i, Y]
        along = dx * along_x + dy * along_y
        inside = min(max(along, 0.0), length)
        if i == 0:
            inside = min(along, inside)
        if i == last:
            inside = max(along, inside)
        miss_x, miss_y = dx - inside * along_x, dy - inside * along_y
        square = miss_x * miss_x + miss_y * miss_y
        if square < least:
            least, s_m, left_m = square, arc_m[i] + inside, along_x * miss_y - along_y * miss_x
            heading_x, heading_y = along_x, along_y
    return s_m, left_m, math.atan2(heading_y, heading_x)


def lane_heading(centre: Polyline, s_m: float) -> float:
    """Direction of a centre line at an arc length."""
    return _heading_at(centre.points, centre.arc_m, s_m)


@compiled
def _heading_at(points: Points, arc_m: Floats, s_m: float) -> float:
    i = min(max(int(np.searchsorted(arc_m, s_m, side="right")) - 1, 0), len(points) - 2)
    return math.atan2(points[i + 1, Y] - points[i, Y], points[i + 1, X] - points[i, X])


_RIGHT_TURNS: Final = frozenset({"r", "R"})


@dataclass(frozen=True)
class ShoulderWay:
    """A path along a shoulder into a right turn."""

    lane: int
    """The shoulder of the route's first edge."""
    onward: Connection
    """Movement at its end."""
    edges: tuple[int, ...]
    """Edges whose shoulders belong to the path, up to the turn."""


def shoulder_into_turn(network: RoadNetwork, route: Indices, reach_m: float) -> ShoulderWay | None:
    """Shoulder of the route's first edge that leads into the next right turn, here or on later edges.

    The turn is at most ``reach_m`` beyond the first edge. None where no shoulder leads there.
    """
    for lane in network.edges[int(route[0])].lanes if len(route) > 1 else ():
        if network.lanes[lane].kind is LaneKind.SHOULDER and network.lanes[lane].emergency_allowed:
            onward = _onward(network, lane, route)
            edges = _edges_to_turn(network, onward, route, reach_m)
            if onward is not None and edges:
                return ShoulderWay(lane, onward, edges)
    return None


def _onward(network: RoadNetwork, shoulder: int, route: Indices) -> Connection | None:
    """Movement from a shoulder of the route's first edge to the second: a right turn, or to its shoulder."""
    for movement in network.connections_from.get(shoulder, ()):
        target = network.lanes[movement.to_lane]
        if target.edge == int(route[1]) and (movement.direction in _RIGHT_TURNS or target.kind is LaneKind.SHOULDER):
            return movement
    return None


def _edges_to_turn(
    network: RoadNetwork, movement: Connection | None, route: Indices, reach_m: float
) -> tuple[int, ...]:
    """Edges before the right turn; empty if the shoulder ends, or the turn is too far."""
    way_m = 0.0
    for ahead in range(1, len(route)):
        if movement is None or way_m > reach_m:
            return ()
        if movement.direction in _RIGHT_TURNS:
            return tuple(route[:ahead].tolist())
        way_m += network.length_m((*movement.via, movement.to_lane))
        rest = route[ahead:]
        movement = _onward(network, movement.to_lane, rest) if len(rest) > 1 else None
    return ()


# These are no parameters: limits between a fault of the map's geometry and a bend of the road.
_HALF_BLEND_M = 15.0
"""Distance before and after a jump over which the line moves: for 1.75 m (half a lane) 2.3 m/s² at 50 km/h."""
_MOST_M = 2.5
"""Larger lateral moves are bends."""
_PARALLEL_RAD = 0.15
"""The road's directions before and after a jump differ by at most this."""
_SWERVE_RAD = 0.2
"""Lines that turn by less than this have no jump."""


def without_jumps(line: Polyline, starts_m: Floats) -> tuple[Polyline, Floats]:
    """A line along consecutive lanes without lateral jumps, and the arc lengths at which the lanes then begin.

    ``starts_m`` are those on the given line, shape ``(L,)``.
    """
    for number in range(1, len(starts_m)):
        from_m = max(float(starts_m[number]) - _HALF_BLEND_M, 0.0)
        to_m = min(float(starts_m[number]) + _HALF_BLEND_M, line.length_m)
        if _jumps(line, from_m, to_m):
            between = _moved_over(line, from_m, to_m)
            before, after = line.points[line.arc_m < from_m - 1e-6], line.points[line.arc_m > to_m + 1e-6]
            blended = Polyline.through(np.concatenate((before, between, after)))
            whole_m = to_m - from_m
            share = np.clip((starts_m - from_m) / whole_m, 0.0, 1.0)
            starts_m = starts_m + share * (blended.length_m - line.length_m)
            line = blended
    return line, starts_m


def _jumps(line: Polyline, from_m: float, to_m: float) -> bool:
    if to_m - from_m < 2.0:
        return False
    turned = wrap_angle(line.heading_rad(np.arange(from_m, to_m, 0.25)) - line.heading_rad(from_m))
    first, last = line.at(np.array([from_m, to_m - 1e-6]))
    heading = float(line.heading_rad(from_m))
    aside_m = abs(np.cos(heading) * (last - first)[1] - np.sin(heading) * (last - first)[0])
    along = np.abs(turned[-1]) < _PARALLEL_RAD and aside_m < _MOST_M
    return bool(along and np.abs(turned).max() > _SWERVE_RAD)


def _moved_over(line: Polyline, from_m: float, to_m: float) -> Points:
    """Points of the cubic curve between two places of a line, with the line's directions there."""
    ends_m = np.array([from_m, to_m - 1e-6])
    (first, last), headings = line.at(ends_m), line.heading_rad(ends_m)
    way_m = float(np.linalg.norm(last - first))
    start, end = (way_m * np.array([np.cos(heading), np.sin(heading)]) for heading in headings)
    u = np.linspace(0.0, 1.0, max(int(way_m), 2) + 1)[:, None]
    lead, rise = u * (1.0 - u) ** 2, u * u * (3.0 - 2.0 * u)
    return np.asarray(first + rise * (last - first) + lead * start - u * u * (1.0 - u) * end)
