"""Stop and give-way signs of OpenStreetMap, which netconvert leaves out: which edges of the net they bind."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final
from xml.etree.ElementTree import Element

import numpy as np
from defusedxml.ElementTree import fromstring

from siren_ros.numerics.geometry import Polyline, wrap_angle
from siren_ros.roads.map_projection import projected_from_geodetic
from siren_ros.roads.maps.netconvert import normal_edges
from siren_ros.roads.net_parser import permissions_of

STOP: Final = "stop"
GIVE_WAY: Final = "give_way"
_NO_ROADS: Final = frozenset({"footway", "cycleway", "path", "steps", "pedestrian", "bridleway", "track", "corridor"})
_LONGEST_WALK: Final = 50
"""Nodes from a sign to its junction at most."""
_HEADING_LIMIT_RAD: Final = 0.9
_BESIDE_M: Final = 15.0
"""Greatest distance of a sign from the edge that it binds: half of a wide road."""
_BEFORE_M: Final = 60.0
"""Farthest that a sign may be from the end of its edge…"""
_BEYOND_M: Final = 25.0
"""…and how far beyond the end, since netconvert cuts edges back where it joins junctions."""
_EARTH_RADIUS_M: Final = 6_371_000.0


@dataclass(frozen=True)
class SignedEdges:
    """Ids of the edges that end at a sign."""

    stopping: frozenset[str]
    yielding: frozenset[str]


@dataclass(frozen=True)
class _Sign:
    kind: str
    lat_deg: float
    lon_deg: float
    heading_rad: float
    """Of the traffic that it binds, counter-clockwise from east."""


@dataclass(frozen=True)
class _Roads:
    """The roads of an extract as a graph of nodes."""

    places: Mapping[str, tuple[float, float]]
    """Latitude and longitude of each node."""
    ahead: Mapping[str, tuple[str, ...]]
    """Nodes to which traffic may drive from each node."""
    neighbours: Mapping[str, tuple[str, ...]]

    def is_junction(self, node: str) -> bool:
        return len(self.neighbours.get(node, ())) > 2

    def heading_rad(self, start: str, end: str) -> float:
        (lat, lon), (to_lat, to_lon) = self.places[start], self.places[end]
        return math.atan2(to_lat - lat, (to_lon - lon) * math.cos(math.radians(lat)))

    def distance_m(self, start: str, end: str) -> float:
        (lat, lon), (to_lat, to_lon) = self.places[start], self.places[end]
        east = math.radians(to_lon - lon) * math.cos(math.radians(lat))
        return _EARTH_RADIUS_M * math.hypot(east, math.radians(to_lat - lat))

    def way_to_junction_m(self, sign: str, first: str) -> float:
        """Length of the road from a sign over a neighbouring node to the next junction; infinite without one."""
        before, at, length_m = sign, first, self.distance_m(sign, first)
        for _ in range(_LONGEST_WALK):
            if self.is_junction(at):
                return length_m
            onward = [node for node in self.neighbours.get(at, ()) if node != before]
            if not onward:
                return math.inf
            length_m += self.distance_m(at, onward[0])
            before, at = at, onward[0]
        return math.inf


def signed_edges(osm_xml: bytes, net: Element) -> SignedEdges:
    """The edges of a net that the signs of its OpenStreetMap source bind.

    Args:
        osm_xml: The extract.
        net: What netconvert made of it.
    """
    osm = fromstring(osm_xml, forbid_dtd=True)
    roads, directions = _roads(osm)
    edges = [(edge.attrib["id"], centre) for edge in normal_edges(net) if (centre := _centre(edge)) is not None]
    found: dict[str, set[str]] = {STOP: set(), GIVE_WAY: set()}
    for sign in _signs(osm, roads, directions):
        point = _point(net, sign.lat_deg, sign.lon_deg)
        edge = None if point is None else _edge_of(edges, point, sign.heading_rad)
        if edge is not None:
            found[sign.kind].add(edge)
    return SignedEdges(frozenset(found[STOP]), frozenset(found[GIVE_WAY] - found[STOP]))


def drives_on(edge: Element) -> bool:
    """Whether cars may use some lane of an edge."""
    return any(permissions_of(lane.get("allow"), lane.get("disallow")).civilian for lane in edge.iterfind("lane"))


def _tags(element: Element) -> dict[str, str]:
    return {tag.get("k", ""): tag.get("v", "") for tag in element.iterfind("tag")}


def _roads(osm: Element) -> tuple[_Roads, Mapping[str, Mapping[str, str]]]:
    """The road graph; and for each node its successors forward and backward along the ways through it."""
    places = {
        node.attrib["id"]: (float(node.attrib["lat"]), float(node.attrib["lon"]))
        for node in osm.iterfind("node")
        if "lat" in node.attrib and "lon" in node.attrib
    }
    ahead: dict[str, dict[str, None]] = {}
    neighbours: dict[str, dict[str, None]] = {}
    along: dict[str, dict[str, str]] = {}
    for way in osm.iterfind("way"):
        tags = _tags(way)
        if "highway" not in tags or tags["highway"] in _NO_ROADS:
            continue
        nodes = [node.get("ref", "") for node in way.iterfind("nd") if node.get("ref", "") in places]
        forward, backward = _allowed(tags)
        for one, other in pairwise(nodes):
            neighbours.setdefault(one, {})[other] = None
            neighbours.setdefault(other, {})[one] = None
            along.setdefault(one, {})["forward"] = other
            along.setdefault(other, {})["backward"] = one
            if forward:
                ahead.setdefault(one, {})[other] = None
            if backward:
                ahead.setdefault(other, {})[one] = None
    roads = _Roads(
        places,
        {node: tuple(found) for node, found in ahead.items()},
        {node: tuple(found) for node, found in neighbours.items()},
    )
    return roads, along


def _allowed(tags: Mapping[str, str]) -> tuple[bool, bool]:
    """Whether traffic may drive along a way, and against it."""
    oneway = tags.get("oneway", "yes" if tags.get("junction") == "roundabout" else "no")
    return oneway != "-1", oneway not in {"yes", "true", "1"}


def _signs(osm: Element, roads: _Roads, along: Mapping[str, Mapping[str, str]]) -> Iterator[_Sign]:
    for node in osm.iterfind("node"):
        tags, name = _tags(node), node.attrib["id"]
        kind = tags.get("highway", "")
        if kind not in {STOP, GIVE_WAY} or name not in roads.neighbours:
            continue
        for start, end in _bound(name, kind, tags, roads, along.get(name, {})):
            yield _Sign(kind, *roads.places[name], roads.heading_rad(start, end))


def _bound(
    name: str, kind: str, tags: Mapping[str, str], roads: _Roads, along: Mapping[str, str]
) -> Sequence[tuple[str, str]]:
    """The stretches of road, from node to node in driving direction, whose traffic a sign binds."""
    if roads.is_junction(name):
        approaches = [(node, name) for node in roads.neighbours[name] if name in roads.ahead.get(node, ())]
        return approaches if kind == STOP and tags.get("stop", "all") == "all" else ()
    onward = roads.ahead.get(name, ())
    direction = tags.get("direction", "")
    if direction in along and along[direction] in onward:
        return ((name, along[direction]),)
    nearest = min(onward, key=lambda node: roads.way_to_junction_m(name, node), default=None)
    if nearest is None or math.isinf(roads.way_to_junction_m(name, nearest)):
        return ()
    return ((name, nearest),)


def _point(net: Element, lat_deg: float, lon_deg: float) -> tuple[float, float] | None:
    """A place in the net's coordinates; None where its projection is not known."""
    location = net.find("location")
    if location is None:
        return None
    projected = projected_from_geodetic(location.get("projParameter", "!"), lat_deg, lon_deg)
    offset = [float(value) for value in location.get("netOffset", "0,0").split(",")]
    return None if projected is None else (projected[0] + offset[0], projected[1] + offset[1])


def _centre(edge: Element) -> Polyline | None:
    """The middle lane of an edge; None where cars may not use it."""
    lanes = [
        lane.attrib["shape"]
        for lane in edge.iterfind("lane")
        if permissions_of(lane.get("allow"), lane.get("disallow")).civilian
    ]
    if not lanes:
        return None
    points = [[float(value) for value in point.split(",")[:2]] for point in lanes[len(lanes) // 2].split()]
    try:
        return Polyline.through(np.array(points, dtype=np.float64).reshape(-1, 2))
    except ValueError:
        return None


def _edge_of(edges: Sequence[tuple[str, Polyline]], point: tuple[float, float], heading_rad: float) -> str | None:
    """The edge at whose end a sign for a direction of traffic stands: the nearest that runs that way."""
    best: tuple[float, str] | None = None
    for edge_id, centre in edges:
        along, left = (float(value) for value in centre.project(point))
        rest_m = centre.length_m - along
        turned = abs(float(wrap_angle(centre.heading_rad(min(along, centre.length_m)) - heading_rad)))
        if turned > _HEADING_LIMIT_RAD or abs(left) > _BESIDE_M or not -_BEYOND_M <= rest_m <= _BEFORE_M:
            continue
        rank = (abs(left) + 0.2 * abs(rest_m), edge_id)
        best = rank if best is None else min(best, rank)
    return None if best is None else best[1]
