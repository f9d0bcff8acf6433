"""Where people walk: along which sidewalks, one after the other, and off the road where they are on no crossing."""

import re
from collections.abc import Sequence
from itertools import pairwise
from typing import Final

import libsumo
import numpy as np
import shapely

from siren_ros.base.numerics.arrays import Flags, Floats, Points, Rows
from siren_ros.base.numerics.compiled import YAW, X, Y, compiled, within
from siren_ros.simulation.roads.road_network import LaneKind, RoadNetwork

_AREA: Final = re.compile(r":.+_w\d+_0")
_CROSSING: Final = re.compile(r":.+_c\d+_0")
"""SUMO's ids of the lanes where sidewalks meet, and of crossings."""


class Corners:
    """Which sidewalks meet at the corners of junctions, and which corners crossings join, as the running SUMO has them.

    SUMO 1.28 moves who has to cross two streets at a signal from the corner where they wait to another crossing that
    has green, 15 m in one step. So nobody here walks such a way, nor over a street at the junction ``uncrossed``.
    """

    def __init__(self, network: RoadNetwork, uncrossed: str = "") -> None:
        self._network, self._uncrossed = network, uncrossed
        self._at: dict[tuple[str, str], str] = {}
        """Corner of an edge at a junction."""
        beside: dict[str, set[str]] = {}
        for lane in libsumo.lane.getIDList():
            for link in libsumo.lane.getLinks(lane):
                target = link[0]
                for area, other in ((lane, target), (target, lane)):
                    if not _AREA.fullmatch(area):
                        continue
                    if _CROSSING.fullmatch(other):
                        beside.setdefault(other, set()).add(area)
                    elif not other.startswith(":"):
                        self._at[other.rpartition("_")[0], area[1:].rpartition("_w")[0]] = area
        self._joined = frozenset(frozenset(areas) for areas in beside.values())

    def walks(self, start: str, goals: Sequence[str]) -> list[Sequence[str]]:
        """Edges of a walk's parts: each leads to the next goal, or, where no simple way does, to some street ahead."""
        present, entry, found = start, frozenset[str](), list[Sequence[str]]()
        for goal in goals:
            routes = libsumo.simulation.findIntermodalRoute(present, goal) if goal != present else ()
            ways = [route.edges for route in routes if self.leads_simply(route.edges)]
            ways = [edges for edges in ways if not entry & self.met_at(*edges[:2])]
            if not ways and (ahead := self.onward(present, entry)):
                ways = [(present, ahead[self._network.edge_by_id[goal].index % len(ahead)])]
            for edges in ways[:1]:
                found.append(edges)
                present, entry = edges[-1], self.met_at(*edges[-2:])
        return found

    def leads_simply(self, edges: Sequence[str]) -> bool:
        """Whether a walk along some edges crosses at most one street at each junction."""
        return all(self.met_at(before, after) for before, after in pairwise(edges))

    def onward(self, edge: str, entry: frozenset[str]) -> tuple[str, ...]:
        """The streets to which a walk simply leads on from one that was entered at a junction, sorted."""
        here = self._network.edge_by_id[edge]
        ends = {here.from_junction, here.to_junction}
        beside = {other for other, junction in self._at if junction in ends and other != edge}
        return tuple(sorted(other for other in beside if len(at := self.met_at(edge, other)) == 1 and not at & entry))

    def met_at(self, before: str, after: str) -> frozenset[str]:
        """The junctions at which a walk from one edge to another crosses at most one street.

        Nobody leaves a street where he came from: SUMO moves those who turn back to the other side of the sidewalk.
        """
        one, two = (self._network.edge_by_id[edge] for edge in (before, after))
        ends = {one.from_junction, one.to_junction} & {two.from_junction, two.to_junction}
        at = self._uncrossed
        if at in ends and self._at.get((before, at)) != self._at.get((after, at)):
            return frozenset()  # two sides of a street also meet at its other end, but SUMO chooses where to cross
        return frozenset(
            junction
            for junction in ends
            if (first := self._at.get((before, junction))) and (second := self._at.get((after, junction)))
            if first == second or frozenset((first, second)) in self._joined
        )


_DRIVEN: Final = frozenset({LaneKind.DRIVING, LaneKind.CYCLE, LaneKind.SHOULDER})
_FROM_KERB_M: Final = 0.45
"""Least distance from a person's middle to the road: half a body and the mirrors of vehicles."""
_STEPS_OUT_M: Final = 0.9
"""Depth on the road from which a person who walks into it counts as crossing: half a step more than it takes to wait at
the kerb."""
_ALONG_M: Final = 3.2
"""The same depth for a person who walks along the road: around a junction a sidewalk may lie on a lane of the road."""
_INTO: Final = 0.7
"""Sine of the angle to the kerb from which people walk into the road (45°)."""
_KERB_SPACING_M: Final = 0.5
"""Longest piece of the line along which people are kept."""
_KERB_AHEAD_M: Final = 1.3
"""Distance within which the road begins ahead of a person who waits at the kerb."""


class Kerbs:
    """Keeps pedestrians who are on no crossing away from the road; SUMO lets them stand and walk on its edge."""

    def __init__(self, network: RoadNetwork) -> None:
        from scipy.spatial import cKDTree  # noqa: PLC0415 - loads slowly, and traffic without people does not need it

        across = network.connections_over.keys() | network.cycle_connections_over.keys()
        driven = [
            shapely.LineString(lane.centre.points).buffer(lane.width_m / 2.0, cap_style="flat")
            for lane in network.lanes
            if lane.kind in _DRIVEN or lane.index in across
        ]
        self._road = shapely.union_all(driven).buffer(_FROM_KERB_M)
        shapely.prepare(self._road)
        edge = shapely.segmentize(self._road.boundary, _KERB_SPACING_M)
        ends, ring = shapely.get_coordinates(edge), shapely.get_parts(edge)
        of_ring = np.repeat(np.arange(len(ring)), shapely.get_num_coordinates(ring))
        joined = of_ring[:-1] == of_ring[1:]
        self._from_m, self._along_m = ends[:-1][joined], np.diff(ends, axis=0)[joined]
        self._middles = cKDTree(self._from_m + 0.5 * self._along_m)

    def keep_off(self, poses: Floats, crossing: Flags) -> None:
        """Moves people who are on the road but on no crossing to its edge, if it is near.

        The others count as crossing from now on.

        Where a sidewalk leads across the mouth of a side street, people cross without a crossing. ``poses`` are x, y
        and yaw first, shape ``(3 or more, N)``.
        """
        rows = np.flatnonzero(shapely.contains_xy(self._road, *poses[:2]) & ~crossing)
        if len(rows):
            pieces = self._middles.query(poses[:2, rows].T)[1]
            _move_to_edge(poses, crossing, rows, pieces, (self._from_m, self._along_m))

    def ahead(self, x_m: Floats, y_m: Floats, yaw_rad: Floats) -> Flags:
        """Whether the road begins right before people at some places, in the direction in which they look."""
        x_m, y_m = x_m + _KERB_AHEAD_M * np.cos(yaw_rad), y_m + _KERB_AHEAD_M * np.sin(yaw_rad)
        return np.asarray(shapely.contains_xy(self._road, x_m, y_m), np.bool_)


@compiled
def _move_to_edge(poses: Floats, crossing: Flags, rows: Rows, pieces: Rows, edge: tuple[Points, Points]) -> None:
    """Move some of the points to the nearest places on pieces of the road's edge; those far from it cross."""
    from_m, along_m = edge
    for number in range(len(rows)):
        row, piece = rows[number], pieces[number]
        (ax, ay), (dx, dy) = from_m[piece], along_m[piece]
        share = within(((poses[X, row] - ax) * dx + (poses[Y, row] - ay) * dy) / (dx * dx + dy * dy), 0.0, 1.0)
        x, y = ax + share * dx, ay + share * dy
        sine = (np.cos(poses[YAW, row]) * dy - np.sin(poses[YAW, row]) * dx) / np.hypot(dx, dy)
        reach_m = _STEPS_OUT_M if abs(sine) > _INTO else _ALONG_M
        if np.hypot(poses[X, row] - x, poses[Y, row] - y) < reach_m:
            poses[X, row], poses[Y, row] = x, y
        else:
            crossing[row] = True
