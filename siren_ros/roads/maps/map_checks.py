"""Refuses maps that cannot be used: left-hand traffic, for all drivers here keep right, and counts of no real place.

A SUMO net and an OpenDRIVE map say on which side traffic keeps. An OpenStreetMap extract says it by ``driving_side``,
by the direction of its roundabouts, or by its place on Earth. Small texts in a map from which netconvert makes much are
refused before it runs.
"""

import math
import re
from collections.abc import Callable, Mapping, Sequence
from typing import Final
from xml.etree.ElementTree import Element, ParseError

from defusedxml import DefusedXmlException
from defusedxml.ElementTree import fromstring

from siren_ros.errors import MapError
from siren_ros.roads.maps.map_source import MapSource, SourceKind
from siren_ros.roads.maps.openstreetmap import tags_of

DEEPEST: Final = 100
"""Elements inside each other; maps have fewer than 20. netconvert takes a time that grows with the square."""
MOST_LANES: Final = 100
"""Of one way of OpenStreetMap; the widest toll stations have about 50. netconvert takes 20 s for a crossing of 1000."""
LONGEST_CURVE_M: Final = 100_000.0
"""Of one piece of an OpenDRIVE road that is no straight line. netconvert puts a point on it every 2 m."""
MOST_CURVE_M: Final = 20_000_000.0
"""Of all of these and all of their lanes: ten million points, which make a net of 200 MB."""
MOST_REPEATS: Final = 1_000_000
"""Copies of the objects of an OpenDRIVE map; netconvert makes each of them."""
_SHOWN_OF_TEXT: Final = 40

_LEFT_HAND_PLACES: Final[Mapping[str, tuple[float, float, float, float]]] = {
    "Great Britain": (51.1, -8.2, 61.0, 1.8),
    "Great Britain, south coast": (49.95, -6.5, 51.1, 1.0),
    "Ireland": (51.3, -11.0, 55.5, -5.3),
    "Jersey and Guernsey": (49.15, -2.8, 49.55, -1.95),
    "Malta": (35.7, 14.1, 36.1, 14.6),
    "Cyprus": (34.5, 32.2, 35.7, 34.6),
    "Japan": (30.0, 129.7, 42.2, 146.0),
    "Japan, Hokkaido": (42.2, 139.2, 45.6, 146.0),
    "Japan, Ryukyu": (24.0, 122.9, 30.0, 131.5),
    "Hong Kong": (22.15, 113.93, 22.5, 114.3),
    "Australia": (-44.0, 112.9, -9.2, 154.5),
    "New Zealand": (-47.6, 166.0, -34.0, 179.0),
    "Indonesia and Singapore": (-9.2, 95.0, 4.4, 141.0),
    "Malay Peninsula": (4.4, 99.6, 6.6, 104.6),
    "Sabah and Brunei": (4.4, 113.9, 7.4, 119.2),
    "Thailand": (6.6, 99.6, 17.4, 102.2),
    "Thailand, north": (17.4, 98.2, 19.9, 100.0),
    "India, south, and Sri Lanka": (5.9, 68.0, 24.0, 92.0),
    "India, Pakistan and Nepal": (24.0, 67.0, 27.7, 92.5),
    "India and Pakistan, north": (27.7, 70.0, 32.0, 79.0),
    "Pakistan and Kashmir": (32.0, 71.5, 34.5, 76.5),
    "Southern Africa": (-35.0, 11.7, -17.5, 40.0),
    "Zambia, Malawi and Mozambique": (-17.5, 23.5, -13.5, 40.6),
    "Malawi and Tanzania": (-13.5, 31.0, -4.5, 40.6),
    "Kenya": (-4.5, 34.0, 4.0, 40.9),
    "Uganda": (-0.9, 30.2, 3.4, 34.0),
    "Jamaica": (17.6, -78.5, 18.6, -76.1),
    "Bahamas": (22.8, -79.0, 27.3, -73.5),
    "Barbados": (13.0, -59.7, 13.4, -59.4),
    "Trinidad and Tobago": (10.0, -61.95, 11.4, -60.5),
    "Guyana and Suriname": (4.5, -59.8, 8.0, -54.1),
    "Mauritius": (-20.6, 57.2, -19.9, 57.9),
}
"""South, west, north and east limits, in degrees, of areas inside countries with left-hand traffic. Borderlands are not
in the table; there the map itself has to say it (https://wiki.openstreetmap.org/wiki/Key:driving_side)."""


def refuse_unusable_map(source: MapSource, shown_source: str) -> None:
    """Accept a map whose traffic keeps right, or that says nothing of its side, and whose counts a real place can have.

    A document that cannot be read is accepted: the compiler says what is wrong with it. The error names the map by
    ``shown_source``.

    Raises:
        MapError: Traffic keeps left, and the message says how the map shows it; or there is too much of something, and
            the message says of what, and where.
    """
    try:
        root = fromstring(source.content, forbid_dtd=True)
    except (ParseError, DefusedXmlException, ValueError, LookupError):
        return
    side, count = _CHECKS.get(source.kind, (None, None))
    try:
        evidence = side(root) if side else ""
    except (ValueError, LookupError):
        evidence = ""
    if evidence:
        raise MapError(shown_source, f"a map of a place where traffic keeps right; here it keeps left ({evidence})")
    if allowed := _too_deep(root) or (count(root) if count else ""):
        raise MapError(shown_source, allowed)


def _side_of_sumo_net(net: Element) -> str:
    return "lefthand of its net" if net.get("lefthand", "").lower() in {"true", "1", "yes"} else ""


def _side_of_opendrive(drive: Element) -> str:
    left = (road for road in drive.iterfind("road") if road.get("rule", "RHT").upper() == "LHT")
    return next((f'rule="LHT" of road {road.get("id", "")}' for road in left), "")


def _side_of_openstreetmap(osm: Element) -> str:
    ways = [(way, tags_of(way)) for way in osm.iterfind("way")]
    tags_of_all = [tags for _, tags in ways] + [tags_of(relation) for relation in osm.iterfind("relation")]
    sides = {tags["driving_side"] for tags in tags_of_all if "driving_side" in tags}
    if sides:
        return "driving_side=left" if sides == {"left"} else ""
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
        return "its roundabouts run clockwise" if sum(turns) < 0.0 else ""
    if not places:
        return ""
    lat, lon = (sum(values) / len(places) for values in zip(*places.values(), strict=True))
    for name, (south, west, north, east) in _LEFT_HAND_PLACES.items():
        if south <= lat <= north and west <= lon <= east:
            return f"it lies in {name.partition(',')[0]}"
    return ""


def _area_deg2(points: Sequence[tuple[float, float]]) -> float:
    """Signed area of a closed line of latitudes and longitudes; positive where it runs counter-clockwise."""
    sides = zip(points, [*points[1:], *points[:1]], strict=True)
    return sum((lon * to_lat - to_lon * lat) / 2.0 for (lat, lon), (to_lat, to_lon) in sides)


def _too_deep(root: Element) -> str:
    level = [root]
    for _ in range(DEEPEST):
        level = [child for element in level for child in element]
    return f"a map with at most {DEEPEST} elements inside each other" if level else ""


def _lanes_of_openstreetmap(osm: Element) -> str:
    for way in osm.iter("way"):
        for tag in way.iter("tag"):
            value = tag.get("v", "")
            # A longer number is too large as well, and Python refuses it.
            numbers = re.findall("[0-9]+", value) if tag.get("k", "").startswith("lanes") else []
            if any(len(number) > 9 or int(number) > MOST_LANES for number in numbers):
                shown = f"{tag.get('k')}={value[:_SHOWN_OF_TEXT]!r} of way {way.get('id', '')[:_SHOWN_OF_TEXT]!r}"
                return f"a map with at most {MOST_LANES} lanes on a way ({shown})"
    return ""


def _curves_of_opendrive(drive: Element) -> str:
    total_m = repeats = 0.0
    for road in drive.iter("road"):
        lanes = max((sum(1 for _ in section.iter("lane")) for section in road.iter("laneSection")), default=1)
        curves_m = [
            _number(geometry, "length")
            for geometry in road.iter("geometry")
            if any(shape.tag != "line" for shape in geometry)
        ]
        total_m += lanes * sum(curves_m)
        if not max(curves_m, default=0.0) <= LONGEST_CURVE_M or not total_m <= MOST_CURVE_M:
            shown = f"road {road.get('id', '')[:_SHOWN_OF_TEXT]!r}"
            limits = f"{LONGEST_CURVE_M / 1e3:.0f} km, and {MOST_CURVE_M / 1e3:.0f} km of lanes on all of them"
            return f"a map whose curves are no longer than {limits} ({shown})"
        for repeat in road.iter("repeat"):
            distance_m = _number(repeat, "distance")
            repeats += _number(repeat, "length") / distance_m if distance_m > 0.0 else 0.0
        if not repeats <= MOST_REPEATS:
            return f"a map with at most {MOST_REPEATS} copies of objects"
    return ""


def _number(element: Element, name: str) -> float:
    """A number from 0 on; 0 where there is none, and infinite where it is none that can be counted with."""
    try:
        value = float(element.get(name, "0"))
    except ValueError:
        return 0.0
    return math.inf if math.isnan(value) else max(value, 0.0)


_Check = Callable[[Element], str]
_CHECKS: Final[Mapping[SourceKind, tuple[_Check, _Check | None]]] = {
    SourceKind.SUMO: (_side_of_sumo_net, None),
    SourceKind.OPENDRIVE: (_side_of_opendrive, _curves_of_opendrive),
    SourceKind.OPENSTREETMAP: (_side_of_openstreetmap, _lanes_of_openstreetmap),
}
"""What shows that traffic keeps left, and what is allowed where there is too much; empty texts for usable maps."""
