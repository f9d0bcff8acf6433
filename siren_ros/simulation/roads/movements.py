"""How movements and roads relate: which cross, which have the same direction, which roads are opposite."""

from typing import Final

import numpy as np

from siren_ros.base.numerics.arrays import Floats, Points
from siren_ros.base.numerics.geometry import Polyline, wrap_angle
from siren_ros.simulation.roads.road_network import NO_LANE, Connection, Edge, LaneKind, RoadNetwork

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
    return network.lanes[connection.from_lane].centre.cut(network.lanes[connection.from_lane].length_m - 0.01, 1e9)


def movement_turn_rad(network: RoadNetwork, connection: Connection) -> float:
    """Sum of the changes of direction along a movement's path, to both sides."""
    lines = [network.lanes[lane].centre for lane in connection.via]
    return sum(float(np.abs(wrap_angle(np.diff(line.heading_rad(line.arc_m)))).sum()) for line in lines)


def crossing_connections(network: RoadNetwork, connection: Connection) -> tuple[int, ...]:
    """Indices of the junction's civilian movements from other approaches whose paths cross this movement's path."""
    path = _trimmed(movement_path(network, connection))
    approach = network.lanes[connection.from_lane].edge
    return tuple(
        index
        for index, other in network.connections_at[connection.junction]
        if network.lanes[other.from_lane].edge != approach
        and network.is_civilian(other)
        and paths_cross(path, _trimmed(movement_path(network, other)))
    )


def comes_from_the_side(network: RoadNetwork, connection: Connection, other: Connection) -> bool:
    """Whether another movement enters the junction from a street that crosses this one's, not from ahead or behind."""
    lanes = (network.lanes[movement.from_lane].centre for movement in (connection, other))
    heading, its_heading = (lane.heading_rad(lane.length_m) for lane in lanes)
    angle = float(np.abs(wrap_angle(its_heading - heading)))
    return _SIDE_STREET_RAD[0] <= angle <= _SIDE_STREET_RAD[1]


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
    pairs = [(network.lanes[c.from_lane].edge, network.lanes[c.to_lane].edge) for c in network.connections]
    ends = network.lanes[connection.from_lane].edge, network.lanes[connection.to_lane].edge
    numbered = zip(network.connections, pairs, strict=True)
    return tuple(index for index, (c, pair) in enumerate(numbered) if pair == ends and network.is_civilian(c))


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
