"""The EMV's route through a site: the approach to it and the way on after it."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Final

from siren_ros.roads.road_network import RoadNetwork
from siren_ros.roads.routing import EdgeGraph, connections_between, driving_lanes

APPROACH_M: Final = 150.0
"""Length of road that an EMV drives before the place, where the map has it: about 11 s at 50 km/h."""
EXIT_M: Final = 100.0
"""Length of road after the place, where the map has it."""
ROUTE_M: Final = 700.0
"""Whole route: more than 45 s (the longest episode) at 50 km/h, so that no episode runs out of road."""
LEAST_ROUTE_M: Final = 500.0
"""Where the way on is short (it leaves the map), the approach grows until the route is this long: 36 s at 50 km/h."""
_SEARCH_DEPTH: Final = 12

_TURN_COST: Final = {"s": 0, "L": 1, "R": 1, "r": 2, "l": 3, "t": 9}


@dataclass(frozen=True)
class SiteRoute:
    """A route and where on it the place begins."""

    edges: tuple[int, ...]
    start: int
    """Position in ``edges`` of the place's first edge."""
    approach_m: float
    exit_m: float


def route_through(graph: EdgeGraph, stretch: Sequence[int]) -> SiteRoute:
    """A route with a long approach to a stretch of edges and a way on after it, without turning back.

    The approach grows backwards until it is ``APPROACH_M`` long (the stretch not counted), the exit forwards until the
    whole route is ``ROUTE_M`` long; both prefer straight on, then wide roads. The exit prefers
    edges that lead into a loop (``EdgeGraph.endless_edges``); it may then pass an edge twice. Where the route has to
    leave the map soon, the approach becomes longer.
    """
    approach = _approach(graph, stretch, APPROACH_M)
    exit_edges = _exit(graph, (*approach, *stretch))
    after_m = graph.route_length_m((*stretch, *exit_edges))
    if graph.route_length_m((*approach, *stretch, *exit_edges)) < LEAST_ROUTE_M:
        approach = _approach(graph, stretch, LEAST_ROUTE_M - after_m)
    route = (*approach, *stretch, *exit_edges)
    return SiteRoute(
        edges=route,
        start=len(approach),
        approach_m=graph.route_length_m(route) - after_m,
        exit_m=after_m - graph.route_length_m(stretch),
    )


def lanes_through(network: RoadNetwork, edge: int, next_edge: int) -> int:
    """Number of driving lanes that lead from one edge to lanes of their own on the next."""
    movements = [c for c in connections_between(network, edge, next_edge) if network.lanes[c.to_lane].civilian_allowed]
    return min(len({c.from_lane for c in movements}), len({c.to_lane for c in movements}))


def turn_of(network: RoadNetwork, edge: int, next_edge: int) -> str:
    """SUMO's letter for the direction from one edge to the next; of several, the straightest."""
    directions = {
        c.direction
        for c in connections_between(network, edge, next_edge)
        if network.lanes[c.from_lane].civilian_allowed and network.lanes[c.to_lane].civilian_allowed
    }
    return min(directions, key=lambda letter: (_TURN_COST.get(letter, 9), letter), default="t")


def is_reversal(network: RoadNetwork, edge: int, other: int) -> bool:
    """Whether two edges are the two directions of one street."""
    first, second = network.edges[edge], network.edges[other]
    return first.from_junction == second.to_junction and first.to_junction == second.from_junction


def _preference(graph: EdgeGraph, edge: int, next_edge: int, candidate: int) -> tuple[int, int, float, int]:
    network = graph.network
    turn = _TURN_COST.get(turn_of(network, edge, next_edge), 9)
    return turn, -len(driving_lanes(network, candidate)), -graph.length_m[candidate], candidate


def _approach(graph: EdgeGraph, stretch: Sequence[int], wanted_m: float) -> tuple[int, ...]:
    best: tuple[int, ...] = ()
    best_m = 0.0
    trail: list[tuple[int, ...]] = [()]
    while trail:
        path = trail.pop()
        length_m = graph.route_length_m((*path, stretch[0])) - graph.length_m[stretch[0]]
        if length_m > best_m:
            best, best_m = path, length_m
        if best_m >= wanted_m:
            break
        if len(path) == _SEARCH_DEPTH:
            continue
        first = path[0] if path else stretch[0]
        ways = sorted(
            (
                way
                for way in graph.predecessors[first]
                if way not in path and way not in stretch and not is_reversal(graph.network, way, first)
            ),
            key=lambda way: _preference(graph, way, first, way),
            reverse=True,
        )
        trail += [(way, *path) for way in ways]
    return best


def _exit(graph: EdgeGraph, before: Sequence[int]) -> tuple[int, ...]:
    lasting = graph.endless_edges()
    visits = dict.fromkeys(before, 1)
    route = list(before)
    while graph.route_length_m(route) < ROUTE_M or graph.route_length_m(route[len(before) - 1 :]) < EXIT_M:
        edge = route[-1]
        ways = _ways_on(graph, edge, lasting, ROUTE_M - graph.route_length_m(route))
        if not ways:
            break
        way_on = min(ways, key=lambda way: (visits.get(way, 0), _preference(graph, edge, way, way)))
        visits[way_on] = visits.get(way_on, 0) + 1
        route.append(way_on)
    return tuple(route[len(before) :])


def _ways_on(graph: EdgeGraph, edge: int, lasting: Collection[int], missing_m: float) -> tuple[int, ...]:
    """Ways on that lead into a loop, or that complete the route before they leave the map; all where there is none."""
    ways = tuple(way for way in graph.successors[edge] if not is_reversal(graph.network, edge, way))
    return tuple(way for way in ways if way in lasting or graph.length_m[way] >= missing_m) or ways
