"""What netconvert leaves out of OpenStreetMap: stop and give-way signs, and room where lanes fan out.

A sign is a node of a way, ``highway=stop`` or ``highway=give_way``, shortly before a junction. Its ``direction``
(``forward``, ``backward``) says for which traffic it stands; without one it stands for traffic towards the nearer
junction. At the junction's own node it binds all approaches (``stop=all``), as mappers draw all-way stops.
Source: https://wiki.openstreetmap.org/wiki/Tag:highway=stop.
"""

import math
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from typing import Final
from xml.etree.ElementTree import Element

from defusedxml.ElementTree import fromstring

from siren_ros.base.numerics.geometry import Polyline, wrap_angle
from siren_ros.simulation.roads.map_projection import projected_from_geodetic
from siren_ros.simulation.roads.maps.lane_shapes import points_of
from siren_ros.simulation.roads.maps.netconvert import normal_edges
from siren_ros.simulation.roads.movements import movement_turn_rad
from siren_ros.simulation.roads.net_parser import permissions_on
from siren_ros.simulation.roads.road_network import Connection, RoadNetwork

STOP: Final = "stop"
GIVE_WAY: Final = "give_way"
_NO_ROADS: Final = frozenset({"footway", "cycleway", "path", "steps", "pedestrian", "bridleway", "track", "corridor"})
_LONGEST_WALK: Final = 50
"""Greatest number of nodes from a sign to its junction."""
_HEADING_LIMIT_RAD: Final = 0.9
_BESIDE_M: Final = 15.0
"""Greatest distance of a sign from the edge that it binds: half of a wide road."""
_BEFORE_M: Final = 60.0
"""Greatest distance of a sign before the end of its edge."""
_BEYOND_M: Final = 25.0
"""Greatest distance of a sign beyond the end of its edge: netconvert cuts edges back where it joins junctions."""
_EARTH_RADIUS_M: Final = 6_371_000.0
_TAPER_RADIUS_M: Final = 12.0
"""Radius of the joints at which lanes fan out. It makes them about 22 m long, over which a car moves one lane aside at
30 km/h with 3 m/s². netconvert's own joints of 8 m allow 12 km/h."""
_TAPER_SWERVE_RAD: Final = 0.5
"""Sum of the turns to both sides from which a joint needs more length."""


def signed_edges(osm_xml: bytes, net: Element) -> tuple[frozenset[str], frozenset[str]]:
    """Ids of the edges that end at a stop sign, and at a give-way sign, of a net made of an OpenStreetMap extract."""
    roads = _RoadGraph(fromstring(osm_xml, forbid_dtd=True))
    edges = [(edge.attrib["id"], centre) for edge in normal_edges(net) if (centre := _centre(edge)) is not None]
    signed: dict[str, set[str]] = {STOP: set(), GIVE_WAY: set()}
    for node, tags in roads.signs:
        point = _point(net, *roads.places[node])
        for start, end in roads.stretches_bound_by(node, tags):
            edge = None if point is None else _edge_of(edges, point, roads.heading_rad(start, end))
            if edge is not None:
                signed[tags["highway"]].add(edge)
    return frozenset(signed[STOP]), frozenset(signed[GIVE_WAY] - signed[STOP])


def drives_on(edge: Element) -> bool:
    """Whether cars may use at least one lane of an edge."""
    return any(permissions_on(lane).civilian for lane in edge.iterfind("lane"))


def taper_patches(network: RoadNetwork) -> list[Element]:
    """``node`` elements that lengthen the joints between two pieces of a road at which lanes fan out too sharply.

    The lanes then fan out over a way on which nobody has to slow down.
    """
    return [
        Element("node", id=junction, radius=f"{_TAPER_RADIUS_M:g}")
        for junction, numbered in network.connections_at.items()
        if only_joins(network, movements := [movement for _, movement in numbered])
        and any(movement_turn_rad(network, movement) > _TAPER_SWERVE_RAD for movement in movements)
    ]


def only_joins(network: RoadNetwork, movements: Sequence[Connection]) -> bool:
    """Whether all movements lead straight on, without control, each from one road piece to one other."""
    plain = all(c.direction == "s" and c.signal_id is None and not c.must_stop for c in movements)
    pairs = {(network.lanes[c.from_lane].edge, network.lanes[c.to_lane].edge) for c in movements}
    return plain and all(len({pair[side] for pair in pairs}) == len(pairs) for side in (0, 1))


def tags_of(element: Element) -> dict[str, str]:
    """The tags of a node, way or relation, by their keys."""
    return {tag.get("k", ""): tag.get("v", "") for tag in element.iterfind("tag")}


class _RoadGraph:
    """The roads of an extract as a graph of nodes."""

    def __init__(self, osm: Element) -> None:
        self.places = {
            node.attrib["id"]: (float(node.attrib["lat"]), float(node.attrib["lon"]))
            for node in osm.iterfind("node")
            if "lat" in node.attrib and "lon" in node.attrib
        }
        """Latitude and longitude of each node in degrees."""
        # Dictionaries with None as values serve as sets that keep their order.
        self._ahead: defaultdict[str, dict[str, None]] = defaultdict(dict)
        """Nodes to which traffic may drive from each node."""
        self._neighbours: defaultdict[str, dict[str, None]] = defaultdict(dict)
        self._along: defaultdict[str, dict[str, str]] = defaultdict(dict)
        """Each node's successors ``forward`` and ``backward`` along the way through it."""
        for way in osm.iterfind("way"):
            tags = tags_of(way)
            if tags.get("highway", "footway") not in _NO_ROADS:
                self._add(tags, [ref for node in way.iterfind("nd") if (ref := node.get("ref", "")) in self.places])
        nodes = ((node.attrib["id"], tags_of(node)) for node in osm.iterfind("node"))
        self.signs = [
            (node, tags) for node, tags in nodes if tags.get("highway") in {STOP, GIVE_WAY} and node in self._neighbours
        ]
        """Nodes with a sign, and their tags."""

    def _add(self, tags: Mapping[str, str], nodes: Sequence[str]) -> None:
        oneway = tags.get("oneway", "yes" if tags.get("junction") == "roundabout" else "no")
        for node, other in pairwise(nodes):
            self._neighbours[node][other] = self._neighbours[other][node] = None
            self._along[node]["forward"], self._along[other]["backward"] = other, node
            if oneway != "-1":
                self._ahead[node][other] = None
            if oneway not in {"yes", "true", "1"}:
                self._ahead[other][node] = None

    def stretches_bound_by(self, node: str, tags: Mapping[str, str]) -> Iterator[tuple[str, str]]:
        """The stretches of road, from node to node in driving direction, whose traffic a sign binds."""
        onward = self._ahead.get(node, {})
        if self._is_junction(node):
            if tags["highway"] == STOP and tags.get("stop", "all") == "all":
                yield from ((other, node) for other in self._neighbours[node] if node in self._ahead.get(other, ()))
        elif (stated := self._along[node].get(tags.get("direction", ""))) in onward:
            yield node, stated
        elif onward:
            nearest = min(onward, key=lambda other: self._way_to_junction_m(node, other))
            if math.isfinite(self._way_to_junction_m(node, nearest)):
                yield node, nearest

    def _is_junction(self, node: str) -> bool:
        return len(self._neighbours.get(node, ())) > 2

    def _way_to_junction_m(self, sign: str, first: str) -> float:
        """Length of the road from a sign over a neighbouring node to the next junction; infinite without one."""
        before, at, length_m = sign, first, self._distance_m(sign, first)
        for _ in range(_LONGEST_WALK):
            if self._is_junction(at):
                return length_m
            onward = [node for node in self._neighbours.get(at, ()) if node != before]
            if not onward:
                break
            length_m += self._distance_m(at, onward[0])
            before, at = at, onward[0]
        return math.inf

    def heading_rad(self, start: str, end: str) -> float:
        """Direction from one node to another, counter-clockwise from east."""
        (lat, lon), (to_lat, to_lon) = self.places[start], self.places[end]
        return math.atan2(to_lat - lat, (to_lon - lon) * math.cos(math.radians(lat)))

    def _distance_m(self, start: str, end: str) -> float:
        (lat, lon), (to_lat, to_lon) = self.places[start], self.places[end]
        east = math.radians(to_lon - lon) * math.cos(math.radians(lat))
        return _EARTH_RADIUS_M * math.hypot(east, math.radians(to_lat - lat))


def _point(net: Element, lat_deg: float, lon_deg: float) -> tuple[float, float] | None:
    """A place in the net's coordinates; None where the projection is not known."""
    location = net.find("location")
    if location is None:
        return None
    projected = projected_from_geodetic(location.get("projParameter", "!"), lat_deg, lon_deg)
    east_m, north_m = (float(value) for value in location.get("netOffset", "0,0").split(","))
    return None if projected is None else (projected[0] + east_m, projected[1] + north_m)


def _centre(edge: Element) -> Polyline | None:
    """The middle lane of an edge; None where cars may not use it."""
    shapes = [lane.attrib["shape"] for lane in edge.iterfind("lane") if permissions_on(lane).civilian]
    try:
        return Polyline.through(points_of(shapes[len(shapes) // 2])[:, :2]) if shapes else None
    except ValueError:
        return None


def _edge_of(edges: Sequence[tuple[str, Polyline]], point: tuple[float, float], heading_rad: float) -> str | None:
    """The edge at whose end a sign for a direction of traffic stands: the nearest that runs that way."""
    near: list[tuple[float, str]] = []
    for edge_id, centre in edges:
        along, left = (float(value) for value in centre.project(point))
        rest_m = centre.length_m - along
        turned = abs(float(wrap_angle(centre.heading_rad(min(along, centre.length_m)) - heading_rad)))
        if turned <= _HEADING_LIMIT_RAD and abs(left) <= _BESIDE_M and -_BEYOND_M <= rest_m <= _BEFORE_M:
            near.append((abs(left) + 0.2 * abs(rest_m), edge_id))
    return min(near)[1] if near else None
