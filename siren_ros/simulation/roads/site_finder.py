"""Finds the sites of a map, the places where a template's interaction can happen, and rates them."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cache, lru_cache
from typing import Final, Literal

import numpy as np

from siren_ros.base.numerics.geometry import wrap_angle
from siren_ros.errors import MapError
from siren_ros.simulation.roads.road_network import (
    MAPS_KEPT,
    Connection,
    JunctionKind,
    Lane,
    LaneKind,
    RoadNetwork,
    right_hand_image,
)
from siren_ros.simulation.roads.routing import (
    TOWN_LIMIT_MPS,
    EdgeGraph,
    civilian_movements,
    comes_from_the_side,
    crossing_connections,
    driving_lanes,
    edges_in_lane,
    has_right_of_way,
    quiet_reach_m,
    same_direction_connections,
)
from siren_ros.simulation.roads.sites import (
    APPROACH_M,
    ENOUGH_M,
    EXIT_M,
    MOTORWAY_APPROACH_M,
    REQUIREMENTS,
    ROUTE_M,
    SHORTEST_MOTORWAY_M,
    SHORTEST_QUEUE_M,
    SHORTEST_ROAD_M,
    SHORTEST_SHOULDER_M,
    Control,
    NoSite,
    Site,
    SiteKind,
    lanes_through,
    name_between,
    route_through,
    turn_of,
)

_SHOULDER_ENOUGH_M: Final = 100.0
_QUIET_ENOUGH_M: Final = 100.0
_CROSSING_ENOUGH_M: Final = 60.0
_CROSSING_LEAST_M: Final = 30.0
"""Least road of a side street before the junction for a queue. Where side streets are shorter, oncoming vehicles that
turn cross as well."""
_PLAIN_ENOUGH_M: Final = 150.0
_CONTROL_POINTS: Final = 30.0
"""Points that a site has less for each step to a weaker control: more than all others together."""


def find_sites(network: RoadNetwork, kind: SiteKind) -> tuple[Site, ...]:
    """All places of a kind on a map, best first; equal scores keep the order of the map's edges."""
    return _places_on(network)(kind)[0]


def places_without_site(network: RoadNetwork, kind: SiteKind) -> tuple[NoSite, ...]:
    """The roads or junctions of a map that are no place of a kind, in the order of the map's edges, and why."""
    return _places_on(network)(kind)[1]


@lru_cache(maxsize=MAPS_KEPT)
def _places_on(network: RoadNetwork) -> Callable[[SiteKind], tuple[tuple[Site, ...], tuple[NoSite, ...]]]:
    """The sites of a map and the places that are none, looked for once for each kind."""
    driven = right_hand_image(network)

    @cache
    def of_kind(kind: SiteKind) -> tuple[tuple[Site, ...], tuple[NoSite, ...]]:
        places = [*_FINDERS[kind](EdgeGraph.of(driven))]
        sites = sorted((place for place in places if isinstance(place, Site)), key=lambda site: -site.score)
        taken = {site.stretch[-1] for site in sites}
        others = (place for place in places if isinstance(place, NoSite) and place.edge not in taken)
        return tuple(sites), tuple(dict.fromkeys(others))

    return of_kind


def require_site(network: RoadNetwork, kind: SiteKind, shown_map: str = "this map") -> Site:
    """The best place of a kind.

    Raises:
        MapError: There is none; the message says what the map lacks.
    """
    sites = find_sites(network, kind)
    if not sites:
        raise MapError(shown_map, REQUIREMENTS[kind])
    return sites[0]


def multi_lane_roads(graph: EdgeGraph) -> Iterator[Site | NoSite]:
    """Roads of two driving lanes or more in one direction, merged through junctions without signal or stop sign."""
    network = graph.network
    for last in range(len(network.edges)):
        if len(driving_lanes(network, last)) < 2:
            if driving_lanes(network, last):
                yield NoSite(last, "one driving lane")
            continue
        if any(_runs_on(network, last, way) for way in graph.successors[last]):
            continue  # the site of this edge is the road into which it leads
        stretch = wide_stretch_back(graph, last)
        length_m = graph.route_length_m(stretch)
        if length_m < SHORTEST_ROAD_M:
            yield NoSite(last, f"less than {SHORTEST_ROAD_M:.0f} m with two lanes")
            continue
        straight_on = [way for way in graph.successors[last] if turn_of(network, last, way) == "s"]
        route = route_through(graph, (*stretch, *straight_on[:1]))
        way_on = route.edges[route.start + len(stretch) :][:1]
        yield Site(
            kind=SiteKind.MULTI_LANE_ROAD,
            name=name_between(network, stretch[0], last),
            junction=None,
            route=route.edges,
            site_position=route.start,
            site_edge=stretch[0],
            stretch=stretch,
            approach_lane=_leading_lane(network, (*stretch, *way_on)),
            length_m=length_m,
            connections=_indices(network, civilian_movements(network, last, way_on[0]) if way_on else ()),
            crossing=(),
            score=4.0 * share(length_m)
            + _route_score(route.approach_m, route.exit_m, graph.route_length_m(route.edges))
            + 2.0 * share(wide_length_m(graph, route.edges, route.start), ROUTE_M)
            - min(2.0 * _bend_rad(network, stretch) / np.pi, 2.0),
        )


def _leading_lane(network: RoadNetwork, edges: tuple[int, ...]) -> int:
    """The leftmost driving lane of the first edge that leads farthest along the others without a lane change."""
    onward = edges[1:]
    length_m = sum(network.lanes[network.edges[edge].lanes[0]].length_m for edge in onward)

    def edges_ahead(lane: Lane) -> int:
        along = edges_in_lane(network, lane.index, onward, length_m)
        return sum(way == wanted for way, wanted in zip(along, onward, strict=False))

    return max(reversed(driving_lanes(network, edges[0])), key=edges_ahead).index


def queued_approaches(graph: EdgeGraph) -> Iterator[Site | NoSite]:
    """Approaches of two lanes or more to a signal, where two lanes lead on in parallel.

    The better ones are long without turning lanes: the corridor opens beside the leftmost lane, so that a turning lane
    that nobody uses would leave it empty.
    """
    network = graph.network
    for edge, way, movements in _directions(graph):
        through = lanes_through(network, edge, way)
        if not _is_signalised(network, movements):
            yield NoSite(edge, _NO_SIGNAL)
            continue
        if through < 2:
            yield NoSite(edge, "one lane leads on")
            continue
        site = junction_site(graph, SiteKind.QUEUED_APPROACH, movements, wide_stretch_back(graph, edge))
        if site.length_m < SHORTEST_QUEUE_M:
            yield NoSite(edge, f"less than {SHORTEST_QUEUE_M:.0f} m of room for queues")
            continue
        plain_m = graph.route_length_m([edge for edge in site.stretch if len(driving_lanes(network, edge)) == through])
        points = 4.0 * share(site.length_m) + 2.0 * (turn_of(network, edge, way) == "s")
        yield replace(site, score=site.score + (points + 2.0 * share(plain_m, _PLAIN_ENOUGH_M)))


def signal_junctions(graph: EdgeGraph) -> Iterator[Site | NoSite]:
    """Movements under a signal that other movements cross."""
    kind = SiteKind.SIGNAL_JUNCTION
    return _crossed(graph, kind, lambda movements: _is_signalised(graph.network, movements), _NO_SIGNAL)


def stop_junctions(graph: EdgeGraph) -> Iterator[Site | NoSite]:
    """Movements without a signal that have to stop or to give way, and that other movements cross.

    Except at an all-way stop, some come from a side street, have the right of way and leave by another road than these
    movements; only such traffic counts as crossing, and no right turn has any.
    """
    network = graph.network
    waits = "no stop sign, and nobody to give way to"
    for site in _crossed(
        graph, SiteKind.STOP_JUNCTION, lambda movements: all(c.must_stop or c.gives_way for c in movements), waits
    ):
        if isinstance(site, NoSite):
            yield site
            continue
        movements, others = (
            [network.connections[index] for index in group] for group in (site.connections, site.crossing)
        )
        stops = all(movement.must_stop for movement in movements)
        if stops and all(other.must_stop for other in others):
            yield replace(site, control=Control.ALL_WAY_STOP)
            continue
        first = tuple(
            index
            for index, other in zip(site.crossing, others, strict=True)
            if network.lanes[other.to_lane].edge != network.lanes[movements[-1].to_lane].edge
            and has_right_of_way(network, movements[-1], other)
        )
        if not first:
            yield NoSite(site.site_edge, waits)
            continue
        ranked = network.junctions[movements[0].junction].kind is not JunctionKind.UNCONTROLLED
        unsigned = Control.GIVE_WAY if ranked else Control.UNCONTROLLED
        control = Control.TWO_WAY_STOP if stops else unsigned
        weaker = list(Control).index(control)
        yield replace(site, crossing=first, control=control, score=site.score - _CONTROL_POINTS * weaker)


def shoulder_turns(graph: EdgeGraph) -> Iterator[Site | NoSite]:
    """Right turns along a shoulder that begins before the turn, and that goes on after it or leads to a lane."""
    network = graph.network
    turns = [connection for connection in network.connections if connection.direction == "r"]
    along = [turn for turn in turns if _on_shoulders(network, turn)]
    edges = {network.lanes[turn.from_lane].edge for turn in along}
    for connection in turns:
        source, target = network.lanes[connection.from_lane], network.lanes[connection.to_lane]
        if source.edge not in edges and network.is_civilian(connection):
            yield NoSite(source.edge, "no shoulder along its right turn")
        if connection not in along:
            continue
        after_m = target.length_m if target.kind is LaneKind.SHOULDER else SHORTEST_SHOULDER_M
        if min(source.length_m, after_m) < SHORTEST_SHOULDER_M:
            yield NoSite(source.edge, f"less than {SHORTEST_SHOULDER_M:.0f} m of shoulder before or after the turn")
            continue
        if movements := civilian_movements(network, source.edge, target.edge):
            site = junction_site(graph, SiteKind.SHOULDER_RIGHT_TURN, movements, (source.edge,))
            before_m, after_m = _shoulder_m(network, source, "from_lane"), _shoulder_m(network, target, "to_lane")
            yield replace(
                site,
                approach_lane=source.index,
                length_m=before_m + after_m,
                connections=_indices(network, [connection]),
                crossing=crossing_connections(network, connection),
                score=site.score + 2.0 * share(before_m, _SHOULDER_ENOUGH_M) + 2.0 * share(after_m, _SHOULDER_ENOUGH_M),
            )


def motorway_stretches(graph: EdgeGraph) -> Iterator[Site | NoSite]:
    """Roads out of town of two driving lanes or more, as far as nobody joins or leaves and all lanes lead on."""
    network = graph.network
    for last in range(len(network.edges)):
        lanes = driving_lanes(network, last)
        if not lanes:
            continue
        if len(lanes) < 2 or lanes[-1].speed_limit_mps <= TOWN_LIMIT_MPS:
            yield NoSite(last, "one driving lane" if len(lanes) < 2 else "a limit of a town")
            continue
        if any(_goes_on(graph, last, way) for way in graph.successors[last]):
            continue  # the site of this edge is the stretch to which it leads
        stretch: tuple[int, ...] = (last,)
        while ways := [
            way for way in graph.predecessors[stretch[0]] if way not in stretch and _goes_on(graph, way, stretch[0])
        ]:
            stretch = (*ways, *stretch)
        length_m = graph.route_length_m(stretch)
        if length_m < SHORTEST_MOTORWAY_M:
            yield NoSite(last, f"less than {SHORTEST_MOTORWAY_M:.0f} m on which nobody joins or leaves")
            continue
        onward = sorted(graph.successors[last], key=lambda way: -lanes_through(network, last, way))[:1]
        route = route_through(graph, (*stretch, *onward), MOTORWAY_APPROACH_M)
        yield Site(
            kind=SiteKind.MOTORWAY_STRETCH,
            name=name_between(network, stretch[0], last),
            junction=None,
            route=route.edges,
            site_position=route.start,
            site_edge=stretch[0],
            stretch=stretch,
            approach_lane=driving_lanes(network, stretch[0])[-1].index,
            length_m=length_m,
            connections=_indices(network, civilian_movements(network, last, onward[0]) if onward else ()),
            crossing=(),
            score=length_m / SHORTEST_MOTORWAY_M + _route_score(route.approach_m, route.exit_m, ROUTE_M),
        )


def _goes_on(graph: EdgeGraph, edge: int, way: int) -> bool:
    """Whether an edge out of town leads to one other edge alone, each lane to its own lane, and no other road joins."""
    network = graph.network
    alone = len(graph.successors[edge]) == 1 and len(graph.predecessors[way]) == 1
    lanes = driving_lanes(network, edge)
    same = len(lanes) == len(driving_lanes(network, way)) == lanes_through(network, edge, way)
    movements = civilian_movements(network, edge, way)
    free = all(c.signal_id is None and not c.must_stop for c in movements)
    return alone and same and free and lanes[-1].speed_limit_mps > TOWN_LIMIT_MPS


def _on_shoulders(network: RoadNetwork, movement: Connection) -> bool:
    source, target = network.lanes[movement.from_lane], network.lanes[movement.to_lane]
    return source.kind is LaneKind.SHOULDER and target.kind in {LaneKind.SHOULDER, LaneKind.DRIVING}


_NO_SIGNAL: Final = "no signal that is both red and green"
_FINDERS: Final[Mapping[SiteKind, Callable[[EdgeGraph], Iterator[Site | NoSite]]]] = {
    SiteKind.MULTI_LANE_ROAD: multi_lane_roads,
    SiteKind.QUEUED_APPROACH: queued_approaches,
    SiteKind.SIGNAL_JUNCTION: signal_junctions,
    SiteKind.STOP_JUNCTION: stop_junctions,
    SiteKind.SHOULDER_RIGHT_TURN: shoulder_turns,
    SiteKind.MOTORWAY_STRETCH: motorway_stretches,
}


def share(length_m: float, enough_m: float = ENOUGH_M) -> float:
    """A length as a share of a sufficient length, at most 1."""
    return min(length_m, enough_m) / enough_m


def _route_score(approach_m: float, exit_m: float, length_m: float) -> float:
    """Points, at most 4, for the lengths of the approach, the way on and the whole route."""
    return 2.0 * share(approach_m, APPROACH_M) + share(exit_m, EXIT_M) + share(length_m, ROUTE_M)


def wide_stretch_back(graph: EdgeGraph, edge: int) -> tuple[int, ...]:
    """The edge and those before it, as far as two lanes run straight on with neither signal nor stop sign between."""
    stretch: tuple[int, ...] = (edge,)
    while ways := [
        way for way in graph.predecessors[stretch[0]] if way not in stretch and _runs_on(graph.network, way, stretch[0])
    ]:
        stretch = (ways[0], *stretch)
    return stretch


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


def _indices(network: RoadNetwork, connections: Sequence[Connection]) -> tuple[int, ...]:
    """Positions in ``network.connections``."""
    return tuple(network.connection_index[c.from_lane, c.to_lane] for c in connections)


def _directions(graph: EdgeGraph) -> Iterator[tuple[int, int, tuple[Connection, ...]]]:
    for edge, ways in enumerate(graph.successors):
        for way in ways:
            if turn_of(graph.network, edge, way) != "t":
                yield edge, way, civilian_movements(graph.network, edge, way)


def _is_signalised(network: RoadNetwork, movements: Sequence[Connection]) -> bool:
    first = movements[0]
    signalised = first.signal_id is not None and network.junctions[first.junction].kind is JunctionKind.SIGNAL
    return signalised and first.alternates


def junction_site(graph: EdgeGraph, kind: SiteKind, movements: Sequence[Connection], stretch: tuple[int, ...]) -> Site:
    """A place at the junction after a stretch; its score is that of the route alone."""
    network = graph.network
    edge, next_edge = stretch[-1], network.lanes[movements[0].to_lane].edge
    route = route_through(graph, (*stretch, next_edge))
    length_m = graph.route_length_m(stretch)
    approach_m, exit_m = route.approach_m + length_m, route.exit_m + graph.length_m[next_edge]
    junction = movements[0].junction
    return Site(
        kind=kind,
        name=name_between(network, edge, next_edge),
        junction=junction,
        route=route.edges,
        site_position=route.start + len(stretch) - 1,
        site_edge=edge,
        stretch=stretch,
        approach_lane=movements[-1].from_lane,
        length_m=length_m,
        connections=_indices(network, movements),
        crossing=(),
        score=_route_score(approach_m, exit_m, graph.route_length_m(route.edges)),
    )


def _crossed(
    graph: EdgeGraph, kind: SiteKind, binding: Callable[[Sequence[Connection]], bool], unbound: str
) -> Iterator[Site | NoSite]:
    network = graph.network
    lasting = graph.endless_edges
    for edge, way, movements in _directions(graph):
        if not binding(movements):
            yield NoSite(edge, unbound)
            continue
        crossing = sorted({index for c in movements for index in crossing_connections(network, c)})
        if not crossing:
            yield NoSite(edge, "nobody crosses")
            continue
        sources = {index: network.connections[index].from_lane for index in crossing}
        from_side = [i for i in crossing if comes_from_the_side(network, movements[-1], network.connections[i])]
        side_lanes = {sources[index] for index in from_side}
        side_m = sum(quiet_reach_m(network, lane, _CROSSING_ENOUGH_M) for lane in side_lanes)
        if side_m < _CROSSING_LEAST_M:
            from_side += [index for index in crossing if index not in from_side]
        site = junction_site(graph, kind, movements, (edge,))
        own = crossing_connections(network, movements[-1])  # the EMV's; some cross only the movements beside it
        crossing_it = tuple(index for index in from_side if index in own)
        quality = (
            2.0 * (turn_of(network, edge, way) == "s")
            + 2.0 * min(lanes_through(network, edge, way), 2)
            + min(len({network.lanes[lane].edge for lane in sources.values()}), 3) / 3.0
            + min(len(same_direction_connections(network, movements[-1])), 2) / 2.0
            + 2.0 * share(site.length_m, _QUIET_ENOUGH_M)
            + share(quiet_reach_m(network, site.approach_lane, _QUIET_ENOUGH_M), _QUIET_ENOUGH_M)
            + share(side_m, _CROSSING_ENOUGH_M)
            + min(len({network.lanes[lane].edge for lane in side_lanes}), 2)
            + 1.0 * (site.route[-1] in lasting)
        )
        yield replace(site, crossing=crossing_it or tuple(from_side), score=site.score + quality)


def _shoulder_m(network: RoadNetwork, lane: Lane, end: Literal["from_lane", "to_lane"]) -> float:
    """Length of a shoulder and its straight continuations back or on; counting stops at ``ENOUGH_M``."""
    beyond = network.connections_to if end == "from_lane" else network.connections_from
    length_m, seen = 0.0, set[int]()
    at: int | None = lane.index
    while at is not None and at not in seen and length_m < ENOUGH_M:
        seen.add(at)
        length_m += network.lanes[at].length_m
        at = next((getattr(c, end) for c in beyond.get(at, ()) if c.direction == "s"), None)
    return length_m
