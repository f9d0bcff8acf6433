"""Routes: sequences of edges, the lanes along them, and the shortest ones."""

import heapq
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import groupby, pairwise
from typing import Final

import numpy as np

from siren_ros.base.numerics.geometry import Polyline
from siren_ros.errors import InputError
from siren_ros.simulation.roads.road_network import MAPS_KEPT, Connection, Lane, LaneKind, RoadNetwork

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


def shortest_path(
    graph: EdgeGraph, from_edge: int, to_edge: int, avoid: Collection[int] = ()
) -> tuple[int, ...] | None:
    """The shortest route from one edge to another, both included; None where there is none.

    Dijkstra over edges by length; among routes of equal length the one with the smaller edge indices wins.
    """
    refused = frozenset(avoid)
    cost, before = {from_edge: graph.length_m[from_edge]}, dict[int, int]()
    heap, done = [(cost[from_edge], from_edge)], set[int]()
    while heap:
        _, edge = heapq.heappop(heap)
        if edge == to_edge:
            route = [edge]
            while route[-1] in before:
                route.append(before[route[-1]])
            return tuple(reversed(route))
        if edge in done:
            continue
        done.add(edge)
        for ahead in graph.successors[edge]:
            reach = cost[edge] + graph.length_m[ahead]
            if ahead not in refused and ahead not in done and reach < cost.get(ahead, float("inf")):
                cost[ahead] = reach
                before[ahead] = edge
                heapq.heappush(heap, (reach, ahead))
    return None


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
