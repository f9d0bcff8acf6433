"""Prolongs roads that end at a map's border too near to a junction for an emergency vehicle to drive up or away.

Maps of single junctions, as reinforcement learning and tests of planners have them, end some metres behind it. Such a
road is continued in a straight line, with the lanes and limits that it has at its end. Its edges say by how much
(parameter ``prolonged_m`` of the net), and so do episodes on them.

A road ends at the border where nothing of the map lies ahead. A cul-de-sac between other roads stays as it is.
"""

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from typing import Final
from xml.etree.ElementTree import Element, SubElement

import numpy as np
import shapely
from defusedxml.ElementTree import fromstring

from siren_ros.base.numerics.arrays import Points
from siren_ros.simulation.roads.maps.netconvert import document, points_of, text_of
from siren_ros.simulation.roads.net_parser import PROLONGED, prolonged_m
from siren_ros.simulation.roads.road_network import Edge, JunctionKind, Lane, RoadNetwork
from siren_ros.simulation.roads.routing import EdgeGraph, driving_lanes, is_out_of_town
from siren_ros.simulation.roads.sites import LEAST_ROUTE_M

NEEDED_M: Final = LEAST_ROUTE_M / 2.0
"""Length of a road between a junction and the border: a route over two of them is as long as an episode needs."""
_LEAST_M: Final = 10.0
"""Roads are not prolonged by less: two cars."""
_CLEAR_M: Final = 10.0
"""Distance at which a prolonged road ends before another prolonged one."""
_TOUCH_M: Final = 0.3
"""Width on each side by which prolonged lanes may touch those beside them: maps draw some that overlap."""
_ALIKE: Final = 0.98
"""Least length of the mean of the unit vectors of a road's lanes at its end: they differ by about 10° at most."""
_CONTROLLED: Final = frozenset({JunctionKind.SIGNAL, JunctionKind.ALL_WAY_STOP, JunctionKind.PRIORITY_STOP})


def with_prolonged_ends(
    net: bytes,
    network: RoadNetwork,
    further: Collection[str] = (),
    needed_m: float = NEEDED_M,
    *,
    out_of_town: bool = False,
) -> bytes:
    """A net whose roads between a junction and the border are long enough, where there is space.

    Args:
        net: A SUMO net.
        network: The road network of this net.
        further: Edges at open ends that become longer by up to ``needed_m`` in any case, also towards other roads.
        needed_m: Least length of these roads.
        out_of_town: Whether only roads of two lanes or more with a limit above that of towns are prolonged.

    Returns:
        The same bytes where no road is too short.
    """
    shifts = dict(_shifts(network, further, needed_m, out_of_town=out_of_town))
    if not shifts:
        return net
    root = fromstring(net, forbid_dtd=True)
    for edge in root.iterfind("edge"):
        if edge.get("function", "normal") == "normal":
            _prolong(edge, {end: shifts[edge.attrib[end]] for end in ("from", "to") if edge.get(end) in shifts})
        elif (shift := shifts.get(edge.attrib["id"][1:].rpartition("_")[0])) is not None:
            for lane in edge.iterfind("lane"):
                _move(lane, "shape", shift)
                _move(lane, "outlineShape", shift)
    for junction in root.iterfind("junction"):
        if (shift := shifts.get(junction.attrib["id"])) is not None:
            _move(junction, "shape", shift)
            for axis, metres in zip("xy", shift.tolist(), strict=True):
                junction.set(axis, f"{float(junction.attrib[axis]) + metres:.2f}")
    return document(root)


def _move(element: Element, attribute: str, shift: Points) -> None:
    if element.get(attribute):
        points = points_of(element.attrib[attribute])
        points[:, :2] += shift
        element.set(attribute, text_of(points))


def _prolong(edge: Element, by: Mapping[str, Points]) -> None:
    """Adds a point to the shapes of an edge at each end that is prolonged, and says so."""
    if not by:
        return
    for part in (edge, *edge.iterfind("lane")):
        for end, shift in by.items() if part.get("shape") else ():
            points = points_of(part.attrib["shape"])
            point = points[-1 if end == "to" else 0].copy()
            point[:2] += shift
            part.set("shape", text_of(np.insert(points, len(points) if end == "to" else 0, point, axis=0)))
    longer_m = prolonged_m(edge) + sum(float(np.hypot(*shift)) for shift in by.values())
    for said in edge.findall(f"param[@key='{PROLONGED}']"):
        edge.remove(said)
    SubElement(edge, "param", key=PROLONGED, value=f"{longer_m:.1f}")


def open_edges(network: RoadNetwork) -> list[str]:
    """Edges with an open end where they can become longer, in space between other roads, too."""
    beside, at_end = roads_at(network)
    named = {edge.edge_id: end for end in beside if len(beside[end]) == 1 for edge in at_end[end]}
    ends = dict(_shifts(network, named))
    return [name for name, end in named.items() if end in ends]


def roads_at(network: RoadNetwork) -> tuple[dict[str, set[str]], dict[str, list[Edge]]]:
    """By node, the nodes from and to which roads lead, and the edges with driving lanes that begin or end there."""
    beside: dict[str, set[str]] = {}
    at_end: dict[str, list[Edge]] = {}
    for edge in network.edges:
        if driving_lanes(network, edge.index):
            for end, other in ((edge.from_junction, edge.to_junction), (edge.to_junction, edge.from_junction)):
                beside.setdefault(end, set()).add(other)
                at_end.setdefault(end, []).append(edge)
    return beside, at_end


def _shifts(
    network: RoadNetwork, further: Collection[str], needed_m: float = NEEDED_M, *, out_of_town: bool = False
) -> Iterator[tuple[str, Points]]:
    """The dead ends that are moved, and by how much, shape ``(2,)``."""
    beside, at_end = roads_at(network)
    dead = [end for end in beside if len(beside[end]) == 1]
    if out_of_town:
        dead = [end for end in dead if any(is_out_of_town(network, edge.index) for edge in at_end[end])]
    short = {end: needed_m - _road_m(network, end, beside, at_end, needed_m) for end in dead}
    wanted = {end for end in short if any(edge.edge_id in further for edge in at_end[end])}
    short |= dict.fromkeys(wanted, needed_m)
    ends = sorted(end for end, lacking_m in short.items() if lacking_m >= _LEAST_M)
    areas = [_area(lane) for lane in network.lanes] if ends else []
    own = _lanes_at(network, ends)
    tree, taken = shapely.STRtree(areas), list[shapely.Polygon]()
    for end in ends:
        along, corridor = _ahead(network, end, at_end[end])
        size_m = float(np.hypot(*np.subtract(*np.split(shapely.total_bounds(areas), 2))))
        if not along.any() or (end not in wanted and not _is_free(corridor(size_m), tree, own[end])):
            continue
        by_m = short[end]
        while by_m >= _LEAST_M and not _is_free(corridor(by_m + _CLEAR_M), tree, own[end], taken):
            by_m -= _CLEAR_M
        if by_m >= _LEAST_M:
            taken.append(corridor(by_m))
            yield end, by_m * along


def _is_free(
    area: shapely.Polygon, lanes: shapely.STRtree, own: set[int], taken: Collection[shapely.Polygon] = ()
) -> bool:
    """Whether no lane but some lies in an area, and none of the areas that are taken already."""
    return own.issuperset(lanes.query(area, "intersects").tolist()) and not any(map(area.intersects, taken))


def _lanes_at(network: RoadNetwork, ends: Sequence[str]) -> dict[str, set[int]]:
    own: dict[str, set[int]] = {end: set() for end in ends}
    for edge in network.edges:
        for end in {edge.from_junction, edge.to_junction} & own.keys():
            own[end].update(edge.lanes)
    return own


def _road_m(
    network: RoadNetwork, end: str, beside: Mapping[str, set[str]], at_end: Mapping[str, list[Edge]], needed_m: float
) -> float:
    """Length of the road from a dead end to the first junction, at most ``needed_m``; that where it leads to none."""
    before, node, length_m = end, next(iter(beside[end])), 0.0
    while length_m < needed_m:
        ends = {before, node}
        edges = (edge.index for edge in at_end[before] if {edge.from_junction, edge.to_junction} == ends)
        length_m += min(EdgeGraph.of(network).length_m[edge] for edge in edges)
        junction = network.junctions.get(node)  # a damaged net may lack it
        if len(beside[node]) > 2 or (junction is not None and junction.kind in _CONTROLLED):
            return length_m
        if len(beside[node]) == 1:
            break
        before, node = node, next(iter(beside[node] - {before}))
    return needed_m


def _area(lane: Lane) -> shapely.Polygon:
    return shapely.LineString(lane.centre.points).buffer(lane.width_m / 2.0, cap_style="flat")


def _ahead(network: RoadNetwork, end: str, edges: list[Edge]) -> tuple[Points, Callable[[float], shapely.Polygon]]:
    """The direction in which a road goes on after its end, and the area that it then takes, by its length.

    The direction is zero where the lanes end in different ones.
    """
    lanes = [(edge, network.lanes[lane]) for edge in edges for lane in edge.lanes]
    tips, headings = [], []
    for edge, lane in lanes:
        at_m, turn = (lane.length_m, 0.0) if edge.to_junction == end else (0.0, np.pi)
        tips.append(lane.centre.at(at_m))
        headings.append(float(lane.centre.heading_rad(at_m)) + turn)
    mean = np.array([np.cos(headings).mean(), np.sin(headings).mean()])
    alike = float(np.hypot(*mean))
    along = mean / alike if alike >= _ALIKE else np.zeros(2)
    left = np.array([-along[1], along[0]])
    half_m = np.array([lane.width_m / 2.0 for _, lane in lanes]) - _TOUCH_M
    aside = np.array(tips) @ left
    start = float(np.max(np.array(tips) @ along)) + _TOUCH_M
    low, high = float(np.min(aside - half_m)), float(np.max(aside + half_m))

    def corridor(length_m: float) -> shapely.Polygon:
        corners = ((start, low), (start + length_m, low), (start + length_m, high), (start, high))
        return shapely.Polygon([ahead * along + side * left for ahead, side in corners])

    return along, corridor
