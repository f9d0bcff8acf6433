"""A site: the place on a map where an interaction happens, and the EMV's route through it.

Each kind of site has its requirements. The route is the approach to the site and the way on after it. No site is near a
bridge: because this world is flat, vehicles of both roads meet there.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from functools import lru_cache
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt
import shapely

from siren_ros.base.numerics.arrays import Points
from siren_ros.base.numerics.geometry import Polyline
from siren_ros.simulation.roads.road_network import MAPS_KEPT, LaneKind, RoadNetwork
from siren_ros.simulation.roads.routing import (
    TOWN_LIMIT_MPS,
    EdgeGraph,
    civilian_movements,
    connections_between,
    driving_lanes,
)

SHORTEST_ROAD_M: Final = 60.0
"""Least length of a road of two lanes: 4 s at 50 km/h, enough for a yield lane change and a pass."""
SHORTEST_QUEUE_M: Final = 30.0
"""Least length of an approach for queues: four standing cars (7.5 m each) on each of two lanes."""
SHORTEST_SHOULDER_M: Final = 10.0
"""Least length of a shoulder before and after a right turn."""
SHORTEST_MOTORWAY_M: Final = 450.0
"""Least length of a motorway stretch: a queue of 300 m and a way of 150 m up to it."""
ENOUGH_M: Final = 250.0
"""A site that is longer than this is not better for it."""


class SiteKind(StrEnum):
    """The kind of place that a template looks for."""

    MULTI_LANE_ROAD = "multi_lane_road"
    QUEUED_APPROACH = "queued_approach"
    SIGNAL_JUNCTION = "signal_junction"
    STOP_JUNCTION = "stop_junction"
    SHOULDER_RIGHT_TURN = "shoulder_right_turn"
    MOTORWAY_STRETCH = "motorway_stretch"


class Control(StrEnum):
    """The rule by which the EMV's movement at a ``STOP_JUNCTION`` has to wait, the strongest first."""

    ALL_WAY_STOP = "all_way_stop"
    TWO_WAY_STOP = "two_way_stop"
    GIVE_WAY = "give_way"
    UNCONTROLLED = "uncontrolled"


@dataclass(frozen=True)
class Site:
    """A place for an interaction, and the route on which the EMV drives through it."""

    kind: SiteKind
    name: str
    """Name that identifies the site among its kind: the first and the last edge of a road, or the edges before and
    after a junction."""
    junction: str | None
    """The junction where it happens; None for a road."""
    route: tuple[int, ...]
    """Edge indices: the approach, the site, the way on. The way on may pass an edge again."""
    site_position: int
    """Position in ``route`` of ``site_edge``."""
    site_edge: int
    """The edge before the junction, or the first edge of the road."""
    stretch: tuple[int, ...]
    """Edges of the usable stretch in driving order: the road itself, or before a junction the approach whose lanes lead
    up to it."""
    approach_lane: int
    """The lane of ``site_edge`` that the EMV takes: the leftmost one that leads on; the shoulder for a turn on it."""
    length_m: float
    """Length of the usable stretch."""
    connections: tuple[int, ...]
    """Indices of the movements in the EMV's direction, from the right: at the junction, or at the end of the road."""
    crossing: tuple[int, ...]
    """Indices of the civilian movements that cross them: those from side streets, and all where these are short."""
    score: float
    """How good the site is; higher is better, and only sites of one kind can be compared."""
    control: Control | None = None
    """The rule at a ``STOP_JUNCTION``; None for other kinds."""

    @property
    def beyond(self) -> tuple[int, ...]:
        """Edges of the route after ``site_edge``."""
        return self.route[self.site_position + 1 :]


class Lack(NamedTuple):
    """What a site lacks for a template."""

    text: str
    """The same for all sites that lack it."""
    missing_m: float | None = None
    """Length of road that is missing; None where a length would not help."""

    def __str__(self) -> str:
        return self.text if self.missing_m is None else f"{self.text} ({self.missing_m:.0f} m)"


@dataclass(frozen=True)
class NoSite:
    """A place that does not qualify as a site of a kind, with the first requirement that it fails."""

    edge: int
    """The road, or the edge before the junction."""
    lacking: str


def name_between(network: RoadNetwork, first: int, last: int) -> str:
    """A site's name from two edges: ``west_s_3..main_w_3``; one name where they are the same."""
    return "..".join(dict.fromkeys(network.edges[edge].edge_id for edge in (first, last)))


REQUIREMENTS: Final[Mapping[SiteKind, str]] = {
    SiteKind.MULTI_LANE_ROAD: (
        f"a map with a road of two driving lanes or more in one direction, at least {SHORTEST_ROAD_M:.0f} m long"
    ),
    SiteKind.QUEUED_APPROACH: (
        "a map with a signalised junction that a road of two driving lanes or more leads to, with at least "
        f"{SHORTEST_QUEUE_M:.0f} m of room for queues"
    ),
    SiteKind.SIGNAL_JUNCTION: (
        "a map with a signalised junction where a movement straight on (or a turn) is crossed by another one"
    ),
    SiteKind.STOP_JUNCTION: (
        "a map with a junction where a movement has to stop or to give way, and another one crosses it"
    ),
    SiteKind.SHOULDER_RIGHT_TURN: (
        "a map with a right turn that has a shoulder open to emergency vehicles before it, beside it and after it, at "
        f"least {SHORTEST_SHOULDER_M:.0f} m long"
    ),
    SiteKind.MOTORWAY_STRETCH: (
        f"a map with a road out of town, above {3.6 * TOWN_LIMIT_MPS:.0f} km/h, of two driving lanes or more, on which "
        f"nobody joins or leaves for {SHORTEST_MOTORWAY_M:.0f} m"
    ),
}


_TRAFFIC: Final = (LaneKind.DRIVING, LaneKind.SHOULDER, LaneKind.INTERNAL)


def middle_of_site(network: RoadNetwork, site: Mapping[str, object]) -> npt.NDArray[np.float64] | None:
    """Middle of a site's junction, or of its road where it has none, shape ``(2,)``; None where it has neither.

    The site is as an episode's description gives it: ``junction``, ``stretch``.
    """
    junction = network.junctions.get(str(site.get("junction") or ""))
    if junction is not None:
        if len(junction.outline) > 2:
            return np.asarray(shapely.Polygon(junction.outline).buffer(0).centroid.coords[0])
        return np.array([junction.x_m, junction.y_m])
    names = site.get("stretch")
    edges = [network.edge_by_id.get(name) for name in names] if isinstance(names, list | tuple) else []
    roads = ([network.lanes[lane] for lane in edge.lanes] for edge in edges if edge)
    lanes = [driven for road in roads if (driven := [lane for lane in road if lane.kind in _TRAFFIC])]
    lengths = [max(lane.length_m for lane in road) for road in lanes]
    half = sum(lengths) / 2.0
    if not half > 0.0:
        return None
    ends = np.cumsum(lengths)
    place = int(np.searchsorted(ends, half))
    share = 1.0 - (ends[place] - half) / lengths[place]
    return np.mean([lane.centre.at(share * lane.length_m) for lane in lanes[place]], axis=0)


APPROACH_M: Final = 150.0
"""Length of road that an EMV drives before the site, where the map has it: about 11 s at 50 km/h."""
MOTORWAY_APPROACH_M: Final = 2000.0
"""Length of road before a motorway stretch, longer because a second EMV comes up to 60 s later."""
EXIT_M: Final = 100.0
"""Length of road after the site, where the map has it."""
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


def route_through(graph: EdgeGraph, stretch: Sequence[int], least_approach_m: float = APPROACH_M) -> SiteRoute:
    """A route with a long approach to a stretch of edges and a way on after it, without turning back.

    The approach grows backwards until it is ``least_approach_m`` long (the stretch not counted), the exit forwards
    until the whole route is ``ROUTE_M`` long; both prefer straight on, then wide roads. The exit prefers
    edges that lead into a loop (``EdgeGraph.endless_edges``); it may then pass an edge twice. Where the route has to
    leave the map soon, the approach becomes longer.
    """
    approach = way_back(graph, stretch, least_approach_m)
    onward = (*stretch, *_exit(graph, (*approach, *stretch)))
    onward_m = graph.route_length_m(onward)
    if graph.route_length_m((*approach, *onward)) < LEAST_ROUTE_M:
        approach = way_back(graph, stretch, LEAST_ROUTE_M - onward_m)
    route = (*approach, *onward)
    approach_m = graph.route_length_m(route) - onward_m
    return SiteRoute(route, len(approach), approach_m, exit_m=onward_m - graph.route_length_m(stretch))


def lanes_through(network: RoadNetwork, edge: int, next_edge: int) -> int:
    """Number of driving lanes that lead from one edge to lanes of their own on the next."""
    movements = [c for c in connections_between(network, edge, next_edge) if network.lanes[c.to_lane].civilian_allowed]
    return min(len({c.from_lane for c in movements}), len({c.to_lane for c in movements}))


def turn_of(network: RoadNetwork, edge: int, next_edge: int) -> str:
    """SUMO's letter for the direction from one edge to the next; of several, the straightest."""
    directions = {connection.direction for connection in civilian_movements(network, edge, next_edge)}
    return min(directions, key=lambda letter: (_TURN_COST.get(letter, 9), letter), default="t")


def is_reversal(network: RoadNetwork, edge: int, other: int) -> bool:
    """Whether two edges are the two directions of one street."""
    first, second = network.edges[edge], network.edges[other]
    return first.from_junction == second.to_junction and first.to_junction == second.from_junction


def _preference(graph: EdgeGraph, edge: int, next_edge: int, candidate: int) -> tuple[int, int, float, int]:
    """Sorts ways: straight on first, then wide roads, then long ones."""
    turn = _TURN_COST.get(turn_of(graph.network, edge, next_edge), 9)
    return turn, -len(driving_lanes(graph.network, candidate)), -graph.length_m[candidate], candidate


def way_back(graph: EdgeGraph, stretch: Sequence[int], least_m: float) -> tuple[int, ...]:
    """Edges that lead to a stretch. Depth-first search: the first way back that is long enough, else the longest."""
    best_m, best = 0.0, tuple[int, ...]()
    trail = [best]
    while trail and best_m < least_m:
        path = trail.pop()
        way = (*path, stretch[0])
        length_m = graph.route_length_m(way) - graph.length_m[stretch[0]]
        if length_m > best_m:
            best, best_m = path, length_m
        if len(path) < _SEARCH_DEPTH:
            before = [edge for edge in graph.predecessors[way[0]] if not is_reversal(graph.network, edge, way[0])]
            ranked = sorted((_preference(graph, edge, way[0], edge) for edge in before), reverse=True)
            trail += [(edge, *path) for *_, edge in ranked if edge not in path and edge not in stretch]
    return best


def _exit(graph: EdgeGraph, before: Sequence[int]) -> tuple[int, ...]:
    """Ways on that lead into a loop, or that complete the route before they leave the map; any where there is none."""
    lasting, visits = graph.endless_edges, Counter(frozenset(before))
    route = list(before)
    while graph.route_length_m(route) < ROUTE_M or graph.route_length_m(route[len(before) - 1 :]) < EXIT_M:
        edge, missing_m = route[-1], ROUTE_M - graph.route_length_m(route)
        ways = [way for way in graph.successors[edge] if not is_reversal(graph.network, edge, way)]
        ways = [way for way in ways if way in lasting or graph.length_m[way] >= missing_m] or ways
        if not ways:
            break
        way_on = min(ways, key=lambda way: (visits[way], _preference(graph, edge, way, way)))
        visits[way_on] += 1
        route.append(way_on)
    return tuple(route[len(before) :])


@lru_cache(maxsize=MAPS_KEPT)
def bridges(network: RoadNetwork) -> tuple[tuple[int, int, Points], ...]:
    """Where driving lanes of two roads cross outside junctions: both edges, and the places, shape ``(N, 2)``."""
    lanes = [lane for lane in network.lanes if lane.kind is LaneKind.DRIVING]
    centres = [shapely.LineString(lane.centre.points) for lane in lanes]
    pairs = shapely.STRtree(centres).query(centres, predicate="crosses").T.tolist()
    crossed = [(a, b) for a, b in pairs if lanes[a].edge < lanes[b].edge]
    return tuple(
        (lanes[a].edge, lanes[b].edge, shapely.get_coordinates(shapely.intersection(centres[a], centres[b])))
        for a, b in crossed
    )


_TOUCH_M: Final = 2.55
"""Width of the widest vehicles (Directive 96/53/EC): bodies in lanes whose middles are nearer may touch."""
_ALONG: Final = 0.9
"""Lanes at less than about 25° to each other do not cross."""
_LEAST_OVERLAP_M: Final = 1.0


@lru_cache(maxsize=MAPS_KEPT)
def overlaps(network: RoadNetwork) -> Mapping[tuple[int, int], tuple[float, float]]:
    """Stretches on which a lane lies over one of another road, although no junction relates them to each other.

    SUMO's drivers do not know of each other there. Roads that cross, on a bridge too, are none: where ways cross,
    everybody waits (``bridges`` has these places).

    Returns:
        Of each lane and other lane, both ways round, where the stretch begins and ends along the first, in metres.
    """
    junction_of = {lane: way.junction for way in network.connections for lane in way.via}
    lanes = [
        lane
        for lane in network.lanes
        if lane.civilian_allowed and (lane.kind is LaneKind.DRIVING or lane.index in junction_of)
    ]
    lines = np.array([shapely.LineString(lane.centre.points) for lane in lanes], dtype=object)
    first, second = shapely.STRtree(lines).query(lines, predicate="dwithin", distance=_TOUCH_M)
    place = np.array([lane.edge if lane.kind is LaneKind.DRIVING else -1 for lane in lanes], dtype=np.intp)
    at = np.array([junction_of.get(lane.index, "") for lane in lanes], dtype=object)
    related = np.where(place[first] >= 0, place[first] == place[second], (at[first] == at[second]).astype(np.bool_))
    first, second = first[~related], second[~related]
    parts = shapely.intersection(lines[first], shapely.buffer(lines[second], _TOUCH_M, cap_style="flat"))
    found = {}
    for k in np.flatnonzero(shapely.length(parts) >= _LEAST_OVERLAP_M).tolist():
        lane, other = lanes[first[k]], lanes[second[k]]
        along_m, _ = lane.centre.project(shapely.get_coordinates(parts[k]))
        begin_m, end_m = float(along_m.min()), float(along_m.max())
        middle = lane.centre.at(0.5 * (begin_m + end_m))
        turn_rad = _heading_rad(lane.centre, middle) - _heading_rad(other.centre, middle)
        if abs(np.cos(turn_rad)) > _ALONG:
            found[lane.index, other.index] = begin_m, end_m
    return found


def _heading_rad(centre: Polyline, point: Points) -> float:
    along_m, _ = centre.project(point)
    return float(centre.heading_rad(min(max(float(along_m), 0.0), centre.length_m)))
