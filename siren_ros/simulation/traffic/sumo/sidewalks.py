"""Finds along which sidewalks people can walk, one after the other."""

import re
from collections.abc import Sequence
from itertools import pairwise
from typing import Final

import libsumo

from siren_ros.simulation.roads.road_network import RoadNetwork

_AREA: Final = re.compile(r":.+_w\d+_0")
_CROSSING: Final = re.compile(r":.+_c\d+_0")
"""SUMO's ids of the lanes where sidewalks meet, and of crossings."""


class Corners:
    """Which sidewalks meet at the corners of junctions, and which corners crossings join, as the running SUMO has them.

    SUMO 1.28 moves who has to cross two streets at a signal from the corner where they wait to another crossing that
    has green, 15 m in one step. So nobody here walks such a way.
    """

    def __init__(self, network: RoadNetwork) -> None:
        self._network = network
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
        ends = {here.from_junction, here.to_junction} - entry
        beside = {other for other, junction in self._at if junction in ends and other != edge}
        return tuple(sorted(other for other in beside if len(at := self.met_at(edge, other)) == 1 and not at & entry))

    def met_at(self, before: str, after: str) -> frozenset[str]:
        """The junctions at which a walk from one edge to another crosses at most one street.

        Nobody leaves a street where he came from: SUMO moves those who turn back to the other side of the sidewalk.
        """
        one, two = (self._network.edge_by_id[edge] for edge in (before, after))
        return frozenset(
            junction
            for junction in {one.from_junction, one.to_junction} & {two.from_junction, two.to_junction}
            if (first := self._at.get((before, junction))) and (second := self._at.get((after, junction)))
            if first == second or frozenset((first, second)) in self._joined
        )
