"""Sites on roads: stretches of two lanes or more, and how good they are."""

from collections.abc import Iterator, Sequence

import numpy as np

from siren_ros.numerics.geometry import wrap_angle
from siren_ros.roads.road_network import Connection, Lane, RoadNetwork
from siren_ros.roads.routing import EdgeGraph, connections_between, driving_lanes
from siren_ros.roads.sites.site import ENOUGH_M, SHORTEST_ROAD_M, Site, SiteKind
from siren_ros.roads.sites.site_routes import (
    APPROACH_M,
    EXIT_M,
    ROUTE_M,
    SiteRoute,
    lanes_through,
    route_through,
    turn_of,
)


def share(length_m: float, enough_m: float = ENOUGH_M) -> float:
    """A length as a share of a sufficient length, at most 1."""
    return min(length_m, enough_m) / enough_m


def civilian_movements(network: RoadNetwork, edge: int, next_edge: int) -> list[Connection]:
    """Movements from one edge to the next that civilians may make, from the right."""
    return [
        connection
        for connection in connections_between(network, edge, next_edge)
        if network.lanes[connection.from_lane].civilian_allowed and network.lanes[connection.to_lane].civilian_allowed
    ]


def connection_indices(network: RoadNetwork, connections: Sequence[Connection]) -> tuple[int, ...]:
    """Positions in ``network.connections``."""
    index_of = {(c.from_lane, c.to_lane): index for index, c in enumerate(network.connections)}
    return tuple(index_of[c.from_lane, c.to_lane] for c in connections)


def wide_stretch_back(graph: EdgeGraph, edge: int) -> tuple[int, ...]:
    """The edge and those before it, as far as two lanes run straight on with neither signal nor stop sign between."""
    stretch = [edge]
    while True:
        ways = [
            way
            for way in graph.predecessors[stretch[0]]
            if way not in stretch and _runs_on(graph.network, way, stretch[0])
        ]
        if not ways:
            return tuple(stretch)
        stretch.insert(0, ways[0])


def _runs_on(network: RoadNetwork, edge: int, next_edge: int) -> bool:
    movements = civilian_movements(network, edge, next_edge)
    free = all(c.signal_id is None and not c.must_stop for c in movements)
    return free and lanes_through(network, edge, next_edge) >= 2 and turn_of(network, edge, next_edge) == "s"


def wide_length_m(graph: EdgeGraph, route: Sequence[int], position: int) -> float:
    """Length of the part of a route around a position that has two lanes or more all along, junctions included."""
    first = last = position
    while first > 0 and lanes_through(graph.network, route[first - 1], route[first]) >= 2:
        first -= 1
    while last + 1 < len(route) and lanes_through(graph.network, route[last], route[last + 1]) >= 2:
        last += 1
    return graph.route_length_m(route[first : last + 1])


def _bend_rad(network: RoadNetwork, stretch: Sequence[int]) -> float:
    """Sum of the changes of direction along the stretch, in lane bends and between edges."""
    centres = [driving_lanes(network, edge)[-1].centre for edge in stretch]
    heading = np.concatenate([centre.heading_rad(centre.arc_m) for centre in centres])
    return float(np.abs(wrap_angle(np.diff(heading))).sum())


def multi_lane_roads(graph: EdgeGraph) -> Iterator[Site]:
    """Roads of two driving lanes or more in one direction, merged through junctions without signal or stop sign."""
    network = graph.network
    for last in range(len(network.edges)):
        if len(driving_lanes(network, last)) < 2:
            continue
        if any(_runs_on(network, last, way) for way in graph.successors[last]):
            continue
        stretch = wide_stretch_back(graph, last)
        if graph.route_length_m(stretch) >= SHORTEST_ROAD_M:
            yield _road(graph, stretch)


def _road(graph: EdgeGraph, stretch: tuple[int, ...]) -> Site:
    network = graph.network
    length_m = graph.route_length_m(stretch)
    straight_on = [way for way in graph.successors[stretch[-1]] if turn_of(network, stretch[-1], way) == "s"]
    route = route_through(graph, (*stretch, *straight_on[:1]))
    way_on = route.edges[route.start + len(stretch) :][:1]
    at_end = civilian_movements(network, stretch[-1], way_on[0]) if way_on else []
    bend = min(2.0 * _bend_rad(network, stretch) / np.pi, 2.0)
    return Site(
        kind=SiteKind.MULTI_LANE_ROAD,
        name=_road_name(network, stretch),
        junction=None,
        route=route.edges,
        site_position=route.start,
        site_edge=stretch[0],
        stretch=stretch,
        approach_lane=_leading_lane(network, stretch).index,
        length_m=length_m,
        connections=connection_indices(network, at_end),
        crossing=(),
        score=4.0 * share(length_m)
        + route_score(route, graph.route_length_m(route.edges))
        + 2.0 * share(wide_length_m(graph, route.edges, route.start), ROUTE_M)
        - bend,
    )


def route_score(route: SiteRoute, length_m: float) -> float:
    """Points, at most 4, for the lengths of the approach, the way on and the whole route."""
    return 2.0 * share(route.approach_m, APPROACH_M) + share(route.exit_m, EXIT_M) + share(length_m, ROUTE_M)


def _road_name(network: RoadNetwork, stretch: tuple[int, ...]) -> str:
    ids = " ".join(network.edges[edge].edge_id for edge in stretch)
    street = network.edges[stretch[0]].name
    return f"{street} ({ids})" if street else ids


def _leading_lane(network: RoadNetwork, stretch: tuple[int, ...]) -> Lane:
    """The leftmost driving lane of the first edge that leads along the stretch."""
    if len(stretch) == 1:
        return driving_lanes(network, stretch[0])[-1]
    return network.lanes[civilian_movements(network, stretch[0], stretch[1])[-1].from_lane]
