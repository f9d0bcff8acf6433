"""The shoulder as an EMV's way: where it leads into the next right turn, the other vehicles leave it free."""

from dataclasses import dataclass
from typing import Final

from siren_ros.roads.road_network import Connection, LaneKind, RoadNetwork
from siren_ros.world.traffic_state import Indices

_RIGHT_TURNS: Final = frozenset({"r", "R"})


@dataclass(frozen=True)
class ShoulderWay:
    """A way along a shoulder into a right turn."""

    lane: int
    """The shoulder of the route's first edge."""
    onward: Connection
    """The movement out of it."""
    edges: tuple[int, ...]
    """Edges on whose shoulders the way leads, up to the turn."""


def shoulder_into_turn(network: RoadNetwork, route: Indices, reach_m: float) -> ShoulderWay | None:
    """The shoulder of a route's first edge that leads into the next right turn, here or along the next edges.

    Args:
        network: The map.
        route: Edges ahead.
        reach_m: How far beyond the first edge the right turn may be.

    Returns:
        The way; None where no shoulder leads there.
    """
    if len(route) < 2:
        return None
    for lane in network.edges[int(route[0])].lanes:
        found = network.lanes[lane]
        if found.kind is LaneKind.SHOULDER and found.emergency_allowed:
            onward = _onward(network, lane, route)
            edges = _edges_to_turn(network, onward, route, reach_m)
            if onward is not None and edges:
                return ShoulderWay(lane, onward, edges)
    return None


def _onward(network: RoadNetwork, shoulder: int, route: Indices) -> Connection | None:
    """The movement from a shoulder of a route's first edge to the second one: a right turn, or on to its shoulder."""
    for movement in network.connections_from.get(shoulder, ()):
        target = network.lanes[movement.to_lane]
        if target.edge == int(route[1]) and (movement.direction in _RIGHT_TURNS or target.kind is LaneKind.SHOULDER):
            return movement
    return None


def _edges_to_turn(
    network: RoadNetwork, movement: Connection | None, route: Indices, reach_m: float
) -> tuple[int, ...]:
    """Edges before the right turn; empty where the shoulder ends, or the turn is too far away."""
    way_m = 0.0
    for ahead in range(1, len(route)):
        if movement is None or way_m > reach_m:
            return ()
        if movement.direction in _RIGHT_TURNS:
            return tuple(route[:ahead].tolist())
        way_m += sum(network.lanes[item].length_m for item in (*movement.via, movement.to_lane))
        rest = route[ahead:]
        movement = _onward(network, movement.to_lane, rest) if len(rest) > 1 else None
    return ()
