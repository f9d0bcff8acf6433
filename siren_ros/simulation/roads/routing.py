"""Ways over the network: movements across junctions, sequences of edges, and the lanes along them.

Movements and roads relate: which cross, which have the same direction, which roads are opposite. Between lanes is the
rescue lane (Rettungsgasse): German law (StVO § 11 (2)) asks for it on motorways and on roads out of town with two lanes
or more in one direction, as soon as traffic goes at walking pace or stands: between the leftmost lane and the one on
its right.
"""

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import groupby, pairwise
from typing import Final

import numpy as np
import numpy.typing as npt

from siren_ros.base.numerics.arrays import Floats, Points
from siren_ros.base.numerics.geometry import Polyline, wrap_angle
from siren_ros.errors import InputError
from siren_ros.simulation.roads.road_network import (
    MAPS_KEPT,
    NO_LANE,
    Connection,
    Edge,
    JunctionKind,
    Lane,
    LaneKind,
    RoadNetwork,
)

TOWN_LIMIT_MPS: Final = 17.0
"""Roads with a higher limit lead out of town: towns have 50 km/h, and up to 60 km/h on their main roads."""


_SIDE_STREET_RAD: Final = (np.pi / 4.0, 3.0 * np.pi / 4.0)
"""Angles between two approaches that belong to different streets."""
_OPPOSITE_M: Final = 1.0
"""Roads of opposite directions whose boundaries are nearer than this share a centre line: nothing divides them."""
_SWERVE_RAD: Final = np.pi / 4.0
"""Sum of the turns to both sides from which a vehicle has to slow down although its way leads straight on."""
END_TRIM_M: Final = 0.5
"""Length that is cut off both ends of a path before crossings are looked for, so that paths that only fork or merge do
not cross."""


def movement_path(network: RoadNetwork, connection: Connection) -> Polyline:
    """The path of a movement across its junction, from the end of one lane to the start of the next."""
    if connection.via:
        return Polyline.joined([network.lanes[lane].centre for lane in connection.via])
    ends = (network.lanes[connection.from_lane].centre.points[-1], network.lanes[connection.to_lane].centre.points[0])
    if np.linalg.norm(ends[1] - ends[0]) > 2e-6:
        return Polyline.through(np.stack(ends))
    lane = network.lanes[connection.from_lane]
    return lane.centre.cut(lane.length_m - 0.01, lane.length_m)


def movement_turn_rad(network: RoadNetwork, connection: Connection) -> float:
    """Sum of the changes of direction along a movement's path, to both sides."""
    lines = [network.lanes[lane].centre for lane in connection.via]
    return sum(float(np.abs(wrap_angle(np.diff(line.heading_rad(line.arc_m)))).sum()) for line in lines)


def crossing_connections(network: RoadNetwork, connection: Connection) -> tuple[int, ...]:
    """Indices of the junction's civilian movements from other approaches whose paths cross this movement's path."""
    path_of = _trimmed_paths(network)
    path, (left, low, right, high) = path_of(connection)
    approach, crossing = network.lanes[connection.from_lane].edge, []
    for index, other in network.connections_at[connection.junction]:
        if network.lanes[other.from_lane].edge != approach and network.is_civilian(other):
            its_path, box = path_of(other)
            near = box[0] <= right and left <= box[2] and box[1] <= high and low <= box[3]
            crossing += [index] if near and paths_cross(path, its_path) else []
    return tuple(crossing)


@lru_cache(maxsize=MAPS_KEPT)
def _trimmed_paths(network: RoadNetwork) -> Callable[[Connection], tuple[Points, list[float]]]:
    """For each movement the path on which others may cross it, and the corners of the box around that."""
    known: dict[tuple[int, int, tuple[int, ...]], tuple[Points, list[float]]] = {}

    def path_of(connection: Connection) -> tuple[Points, list[float]]:
        key = connection.from_lane, connection.to_lane, connection.via
        if key not in known:
            path = _trimmed(movement_path(network, connection))
            known[key] = path, [*path.min(axis=0).tolist(), *path.max(axis=0).tolist()]
        return known[key]

    return path_of


def comes_from_the_side(network: RoadNetwork, connection: Connection, other: Connection) -> bool:
    """Whether another movement enters the junction from a street that crosses this one's, not from ahead or behind."""
    return _SIDE_STREET_RAD[0] <= abs(_turned_rad(network, connection, other)) <= _SIDE_STREET_RAD[1]


def has_right_of_way(network: RoadNetwork, connection: Connection, other: Connection) -> bool:
    """Whether another movement from a side street goes before one without a signal.

    It does not give way itself, or it comes from the right where no road is the major one.
    """
    turned_rad = _turned_rad(network, connection, other)
    if network.junctions[connection.junction].kind is not JunctionKind.UNCONTROLLED:
        return not other.gives_way and _SIDE_STREET_RAD[0] <= abs(turned_rad) <= _SIDE_STREET_RAD[1]
    return _SIDE_STREET_RAD[0] <= turned_rad <= _SIDE_STREET_RAD[1]


def _turned_rad(network: RoadNetwork, connection: Connection, other: Connection) -> float:
    """Angle from one movement's heading at its line to another's: positive if the other one comes from the right."""
    lanes = (network.lanes[movement.from_lane].centre for movement in (connection, other))
    heading, its_heading = (lane.heading_rad(lane.length_m) for lane in lanes)
    return float(wrap_angle(its_heading - heading))


def quiet_connection_to(network: RoadNetwork, lane: int) -> Connection | None:
    """The only movement into a lane, where it runs straight on, uncontrolled, and no other movement crosses it.

    None where the lane begins at a junction at which others have a say.
    """
    only, *others = network.connections_to.get(lane, ()) or (None,)
    if only is None or others or only.signal_id is not None or only.must_stop or only.direction != "s":
        return None
    return None if crossing_connections(network, only) else only


def is_plain_joint(network: RoadNetwork, connection: Connection) -> bool:
    """Whether a movement only leads from one piece of a road to the next, so that vehicles on it are in nobody's way.

    Maps have junctions on whose one side nobody turns and nobody crosses. They are joints for that side.
    """
    only_way = len(network.connections_from.get(connection.from_lane, ())) == 1
    return only_way and quiet_connection_to(network, connection.to_lane) == connection


def road_lane_of(network: RoadNetwork, lane: int) -> int:
    """The road's lane that a lane belongs to: itself, or on a plain joint the one before; ``NO_LANE`` on a junction."""
    if lane == NO_LANE or network.lanes[lane].kind is not LaneKind.INTERNAL:
        return lane
    movements = network.connections_over.get(lane, ())
    if len(movements) == 1 and is_plain_joint(network, movements[0]):
        return movements[0].from_lane
    return NO_LANE


def quiet_reach_m(network: RoadNetwork, lane: int, enough_m: float) -> float:
    """Length of road before the end of a lane without a junction in between; counting stops at ``enough_m``."""
    reach_m, seen = network.lanes[lane].length_m, {lane}
    before = quiet_connection_to(network, lane)
    while before is not None and before.from_lane not in seen and reach_m < enough_m:
        seen.add(before.from_lane)
        reach_m += network.length_m((before.from_lane, *before.via))
        before = quiet_connection_to(network, before.from_lane)
    return reach_m


def same_direction_connections(network: RoadNetwork, connection: Connection) -> tuple[int, ...]:
    """Indices of the civilian movements that begin and end on the same edges as this one (itself among them)."""
    source, target = (network.lanes[lane].edge for lane in (connection.from_lane, connection.to_lane))
    return tuple(
        index
        for index, c in network.connections_at[connection.junction]
        if (network.lanes[c.from_lane].edge, network.lanes[c.to_lane].edge) == (source, target)
        and network.is_civilian(c)
    )


def paths_cross(first: Points, second: Points) -> bool:
    """Whether two open polylines (shapes ``(K, 2)`` and ``(L, 2)``) have a point in common."""
    a, b = first[:-1, None, :], first[1:, None, :]
    c, d = second[None, :-1, :], second[None, 1:, :]
    side_c, side_d = _turn(a, b, c), _turn(a, b, d)
    side_a, side_b = _turn(c, d, a), _turn(c, d, b)
    return bool(np.any((side_c * side_d <= 0.0) & (side_a * side_b <= 0.0) & (abs(side_c) + abs(side_d) > 0.0)))


def _turn(a: Points, b: Points, c: Points) -> Floats:
    ab, ac = b - a, c - a
    return np.asarray(ab[..., 0] * ac[..., 1] - ab[..., 1] * ac[..., 0])


def _trimmed(path: Polyline) -> Points:
    trim_m = min(END_TRIM_M, path.length_m / 4.0)
    return path.cut(trim_m, path.length_m - trim_m).points


def opposite_edges(network: RoadNetwork) -> dict[int, int]:
    """For each road the one of the opposite direction that touches it, by edge index."""
    pairs: dict[tuple[str, str], list[Edge]] = {}
    for edge in network.edges:
        if not edge.internal:
            pairs.setdefault((edge.from_junction, edge.to_junction), []).append(edge)
    opposite: dict[int, int] = {}
    for (start, end), edges in pairs.items():
        for edge in edges:
            for other in pairs.get((end, start), []):
                lane, facing = network.lanes[edge.lanes[-1]], network.lanes[other.lanes[-1]]
                _, left = facing.centre.project(lane.centre.at(lane.length_m / 2))
                if abs(abs(float(left)) - (lane.width_m + facing.width_m) / 2) < _OPPOSITE_M:
                    opposite[edge.index] = other.index
    return opposite


_TURNAROUND: Final = "t"
"""SUMO's letter of a movement back along the same street. Nets of users have some; no vehicle here turns round."""
LANE_CHANGE_COST: Final = 1.0
"""Cost of one lane change in ``route_path``, against which the tie-breaks below are small."""
_DRIFT_COST: Final = 1e-3
"""Cost of ending one lane away from the preferred one. It keeps the path in its lane where the route allows."""


@dataclass(frozen=True, eq=False)
class EdgeGraph:
    """The edges to which civilians may drive from each edge, by index; junction paths are left out."""

    network: RoadNetwork
    successors: tuple[tuple[int, ...], ...]
    """Edges that follow each edge, sorted; empty for edges without driving lanes."""
    predecessors: tuple[tuple[int, ...], ...]
    length_m: tuple[float, ...]
    """Length of each edge's rightmost driving lane; infinite for an edge without one."""

    @classmethod
    @lru_cache(maxsize=MAPS_KEPT)
    def of(cls, network: RoadNetwork) -> "EdgeGraph":
        """The graph of a network."""
        ahead, behind = ([set[int]() for _ in network.edges] for _ in range(2))
        for connection in network.connections:
            source, target = network.lanes[connection.from_lane], network.lanes[connection.to_lane]
            if network.is_civilian(connection) and connection.direction != _TURNAROUND:
                ahead[source.edge].add(target.edge)
                behind[target.edge].add(source.edge)
        driven = (driving_lanes(network, edge.index) for edge in network.edges)
        lengths_m = tuple(lanes[0].length_m if lanes else float("inf") for lanes in driven)
        successors, predecessors = (tuple(tuple(sorted(group)) for group in groups) for groups in (ahead, behind))
        return cls(network, successors, predecessors, lengths_m)

    @cached_property
    def endless_edges(self) -> frozenset[int]:
        """Edges on which a vehicle never has to leave the map, because a way from there leads into a loop."""
        open_ends = [len(group) for group in self.successors]
        dead = [edge for edge, count in enumerate(open_ends) if count == 0]
        gone = set(dead)
        while dead:
            for before in self.predecessors[dead.pop()]:
                open_ends[before] -= 1
                if open_ends[before] == 0 and before not in gone:
                    gone.add(before)
                    dead.append(before)
        return frozenset(range(len(self.successors))) - gone

    def route_length_m(self, edges: Sequence[int]) -> float:
        """Length of a route; the ways across junctions count as straight lines."""
        lines = [driving_lanes(self.network, edge)[0].centre.points for edge in edges] if len(edges) > 1 else []
        gaps = (float(np.linalg.norm(after[0] - before[-1])) for before, after in pairwise(lines))
        return sum(self.length_m[edge] for edge in edges) + sum(gaps)


def driving_lanes(network: RoadNetwork, edge: int) -> tuple[Lane, ...]:
    """Lanes of an edge that civilians may drive on, from the right."""
    if network.edges[edge].internal:
        return ()
    lanes = (network.lanes[index] for index in network.edges[edge].lanes)
    return tuple(lane for lane in lanes if lane.kind is LaneKind.DRIVING and lane.civilian_allowed)


def is_out_of_town(network: RoadNetwork, edge: int) -> bool:
    """Whether an edge has two driving lanes or more and a limit above that of towns."""
    lanes = driving_lanes(network, edge)
    return len(lanes) > 1 and lanes[-1].speed_limit_mps > TOWN_LIMIT_MPS


def is_leftmost_of_several(network: RoadNetwork, lane: int) -> bool:
    """Whether a lane is the leftmost of its edge's driving lanes, of which there are several."""
    beside = network.edges[network.lanes[lane].edge].lanes
    driving = [index for index in beside if network.lanes[index].kind is LaneKind.DRIVING]
    return len(driving) > 1 and driving[-1] == lane


def connections_between(network: RoadNetwork, edge: int, next_edge: int) -> tuple[Connection, ...]:
    """Movements from one edge to another, shoulders included, from the rightmost lane to the left."""
    return tuple(
        connection
        for lane in network.edges[edge].lanes
        for connection in network.connections_from.get(lane, ())
        if network.lanes[connection.to_lane].edge == next_edge
    )


def civilian_movements(network: RoadNetwork, edge: int, next_edge: int) -> tuple[Connection, ...]:
    """Movements from one edge to the next that civilians may make, from the right."""
    return tuple(filter(network.is_civilian, connections_between(network, edge, next_edge)))


def edges_in_lane(network: RoadNetwork, lane: int, wanted: Sequence[int], least_m: float) -> tuple[int, ...]:
    """Edges to which a lane leads on without a lane change, until they are ``least_m`` long.

    They are those of ``wanted`` as far as it leads along them, and then the ways straight on where there are any.
    """
    edges: list[int] = []
    while sum(network.lanes[network.edges[edge].lanes[0]].length_m for edge in edges) < least_m:
        after = wanted[len(edges)] if edges == list(wanted[: len(edges)]) and len(edges) < len(wanted) else -1
        ways = [way for way in network.connections_from.get(lane, ()) if network.is_civilian(way)]
        ways.sort(key=lambda way: (network.lanes[way.to_lane].edge != after, way.direction != "s"))
        if not ways or network.lanes[ways[0].to_lane].edge in edges:
            break
        lane = ways[0].to_lane
        edges.append(network.lanes[lane].edge)
    return tuple(edges)


def route_path(network: RoadNetwork, edges: Sequence[int], start_lane: int) -> tuple[int, ...]:
    """Lanes along a route, junction paths included, with as few lane changes as the route needs.

    Two lanes of the same edge in a row are a lane change (neighbours, one at a time). A shoulder is used only where
    ``start_lane``, a lane of the first edge, is one, and left where it ends. The path stays near the position of the
    start lane counted from the left.

    Raises:
        InputError: The edges do not follow one another, or ``start_lane`` is not on the first of them.
    """
    ids = [network.edges[edge].edge_id for edge in edges]
    if not edges or network.lanes[start_lane].edge != edges[0]:
        raise InputError("route", ids, "edges that begin at the start lane")
    kinds = {LaneKind.DRIVING, network.lanes[start_lane].kind}
    states: dict[int, tuple[float, tuple[int, ...]]] = {start_lane: (0.0, (start_lane,))}
    for edge, next_edge in zip(edges, [*edges[1:], None], strict=True):
        states = _with_lane_changes(network, edge, states, kinds)
        if next_edge is not None:
            states = _across(network, states, next_edge, kinds)
        if not states:
            raise InputError("route", ids, "edges that follow one another, with lanes of the right kind between them")
    return min(states.values())[1]


_States = dict[int, tuple[float, tuple[int, ...]]]


def _with_lane_changes(network: RoadNetwork, edge: int, states: _States, kinds: Collection[LaneKind]) -> _States:
    lanes = [lane for lane in network.edges[edge].lanes if network.lanes[lane].kind in kinds]
    best: _States = {}
    for target in lanes:
        for origin, (cost, path) in states.items():
            step = 1 if target > origin else -1
            between = tuple(range(origin + step, target + step, step)) if target != origin else ()
            if any(lane not in lanes for lane in between):
                continue
            total = cost + len(between) * (LANE_CHANGE_COST + _DRIFT_COST)
            if target not in best or (total, (*path, *between)) < best[target]:
                best[target] = (total, (*path, *between))
    return best


def _across(network: RoadNetwork, states: _States, next_edge: int, kinds: Collection[LaneKind]) -> _States:
    best: _States = {}
    for lane, (cost, path) in states.items():
        for connection in network.connections_from.get(lane, ()):
            target = network.lanes[connection.to_lane]
            if target.edge != next_edge or target.kind not in kinds:
                continue
            drift = abs(_from_left(network, network.lanes[lane]) - _from_left(network, target))
            state = (cost + drift * _DRIFT_COST, (*path, *connection.via, target.index))
            if target.index not in best or state < best[target.index]:
                best[target.index] = state
    return best


def _from_left(network: RoadNetwork, lane: Lane) -> int:
    return len(network.edges[lane.edge].lanes) - 1 - lane.position


def path_centre(network: RoadNetwork, lanes: Sequence[int]) -> Polyline:
    """The centre line of a path of lanes as ``route_path`` gives it.

    A lane change takes the middle half of its edge, along a half cosine from centre to centre.
    """
    parts: list[Polyline] = []
    road = (network.lanes[lane] for lane in lanes)
    # Two lanes of one road in a row are a lane change; on a junction two lanes of one edge follow one another.
    for _, group in groupby(road, key=lambda lane: (lane.edge, lane.index if network.edges[lane.edge].internal else 0)):
        first, *others = group
        parts.append(_changing(first, others[-1]) if others else first.centre)
    return Polyline.joined(parts)


def _changing(origin: Lane, target: Lane) -> Polyline:
    fraction = np.linspace(0.0, 1.0, max(9, int(origin.length_m / 2.0)))
    share = 0.5 - 0.5 * np.cos(np.pi * np.clip(2.0 * fraction - 0.5, 0.0, 1.0))
    start = origin.centre.at(fraction * origin.length_m)
    end = target.centre.at(fraction * target.length_m)
    return Polyline.through(start + share[:, None] * (end - start))


def rescue_sides(network: RoadNetwork) -> npt.NDArray[np.int8]:
    """Side to which drivers in each lane keep: +1 left in the leftmost one, −1 right in all others, 0 without the duty.

    A path over a joint has the side of the lane from which it comes.
    """
    sides = np.zeros(len(network.lanes), np.int8)
    for edge in range(len(network.edges)):
        if is_out_of_town(network, edge):
            lanes = driving_lanes(network, edge)
            sides[[lane.index for lane in lanes]] = -1
            sides[lanes[-1].index] = 1
    for connection in network.connections:
        sides[list(connection.via)] = sides[connection.from_lane]
    return sides


def rescue_boundary_m(network: RoadNetwork, lane: int) -> float:
    """Offset of the line between the leftmost lane and its right neighbour from a lane's centre, left positive.

    0 on shoulders and on roads of one lane.
    """
    here = network.lanes[lane]
    lanes = (network.lanes[item] for item in network.edges[here.edge].lanes)
    driving = [item for item in lanes if item.kind is LaneKind.DRIVING]
    if here.kind is LaneKind.SHOULDER or len(driving) < 2:
        return 0.0
    leftmost = driving[-1].position
    if here.position >= leftmost:
        return -0.5 * here.width_m
    between = sum(item.width_m for item in driving if here.position < item.position < leftmost)
    return 0.5 * here.width_m + between
