"""On which side of the road traffic keeps, as a map says it or as its place on Earth tells.

An OpenDRIVE map says it by the ``rule`` of its roads, an OpenStreetMap extract by ``driving_side``
(https://wiki.openstreetmap.org/wiki/Key:driving_side), by the direction of its roundabouts, or by its place.
"""

import json
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from typing import Final
from xml.etree.ElementTree import Element, ParseError

import shapely
from defusedxml import DefusedXmlException
from defusedxml.ElementTree import fromstring
from shapely.geometry.base import BaseGeometry

from siren_ros.base.params.resources import params_dir
from siren_ros.simulation.roads.maps.map_source import MapSource, SourceKind
from siren_ros.simulation.roads.maps.netconvert import document
from siren_ros.simulation.roads.maps.openstreetmap import tags_of
from siren_ros.simulation.roads.mirror_image import OTHER_SIDE
from siren_ros.simulation.roads.net_parser import is_left_hand

_SIDED_KEYS: Final = ("sidewalk", "cycleway", "busway", "parking")
"""Keys of OpenStreetMap that name a side of a way, by which netconvert adds lanes."""


def keeps_left(source: MapSource) -> bool:
    """Whether traffic keeps left on a map. The answer is no where the map states neither its side nor its place.

    It is also no where the map cannot be read: the compiler says what is wrong with it.
    """
    told = _TOLD.get(source.kind)
    try:
        return told is not None and told(fromstring(source.content, forbid_dtd=True))
    except (ParseError, DefusedXmlException, ValueError, LookupError):
        return False


def _told_by_opendrive(drive: Element) -> bool:
    return any(road.get("rule", "RHT").upper() == "LHT" for road in drive.iterfind("road"))


def _told_by_openstreetmap(osm: Element) -> bool:
    ways = [(way, tags_of(way)) for way in osm.iterfind("way")]
    tags_of_all = [tags for _, tags in ways] + [tags_of(relation) for relation in osm.iterfind("relation")]
    if sides := {tags["driving_side"] for tags in tags_of_all if "driving_side" in tags}:
        return sides == {"left"}
    places = {
        node.attrib["id"]: (float(node.attrib["lat"]), float(node.attrib["lon"]))
        for node in osm.iterfind("node")
        if {"id", "lat", "lon"} <= set(node.attrib)
    }
    turns = []
    for way, tags in ways:
        nodes = [node.get("ref", "") for node in way.iterfind("nd")]
        if tags.get("junction") == "roundabout" and len(nodes) >= 4 and nodes[0] == nodes[-1]:
            area = _area_deg2([places[node] for node in nodes if node in places])
            turns.append(-area if tags.get("oneway") == "-1" else area)
    if turns:
        return sum(turns) < 0.0
    if not places:
        return False
    lat_deg, lon_deg = (sum(values) / len(places) for values in zip(*places.values(), strict=True))
    return bool(shapely.contains_xy(_left_hand_places(), lon_deg, lat_deg))


def _area_deg2(points: Sequence[tuple[float, float]]) -> float:
    """Signed area of a closed line of latitudes and longitudes; positive where it runs counter-clockwise."""
    sides = zip(points, [*points[1:], *points[:1]], strict=True)
    return sum((lon * to_lat - to_lon * lat) / 2.0 for (lat, lon), (to_lat, to_lon) in sides)


@cache
def _left_hand_places() -> BaseGeometry:
    """Where on Earth traffic keeps left, in degrees of longitude and latitude (``tools/left_hand_places.py``)."""
    places = json.loads((params_dir() / "left_hand_places.json").read_text(encoding="utf-8"))
    return shapely.geometry.shape(places)


_TOLD: Final[Mapping[SourceKind, Callable[[Element], bool]]] = {
    SourceKind.SUMO: is_left_hand,
    SourceKind.OPENDRIVE: _told_by_opendrive,
    SourceKind.OPENSTREETMAP: _told_by_openstreetmap,
}


def with_sides_exchanged(osm: bytes) -> bytes:
    """An extract with the sidewalks, cycle lanes and bus lanes on the other side of their ways.

    netconvert counts the right side of a way as that of the traffic along it, also where traffic keeps left.
    """
    root = fromstring(osm, forbid_dtd=True)
    for tag in root.iter("tag"):
        key = tag.get("k", "").split(":")
        if key[0] in _SIDED_KEYS:
            tag.set("k", ":".join(OTHER_SIDE.get(part, part) for part in key))
            tag.set("v", OTHER_SIDE.get(tag.get("v", ""), tag.get("v", "")))
    return document(root)
