"""On which side of the road a map's traffic keeps. Left-hand traffic is refused: all drivers here keep right.

A SUMO net and an OpenDRIVE map say it. An OpenStreetMap extract says it by ``driving_side``, by the direction of its
roundabouts, or by its place on Earth.
"""

from collections.abc import Mapping, Sequence
from typing import Final
from xml.etree.ElementTree import Element, ParseError

from defusedxml import DefusedXmlException
from defusedxml.ElementTree import fromstring

from siren_ros.errors import MapError
from siren_ros.roads.maps.map_source import MapSource, SourceKind
from siren_ros.roads.maps.openstreetmap import tags_of

ALLOWED: Final = "a map of a place where traffic keeps right; here it keeps left"

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


def refuse_left_hand_traffic(source: MapSource, shown_source: str) -> None:
    """Accept a map whose traffic keeps right, or that says nothing of its side.

    Args:
        source: The map. A document that cannot be read is accepted; whoever compiles it says what is wrong with it.
        shown_source: What the error names as the map.

    Raises:
        MapError: The map's traffic keeps left; the message says how the map shows it.
    """
    evidence = _EVIDENCE.get(source.kind)
    try:
        found = evidence(fromstring(source.content, forbid_dtd=True)) if evidence else ""
    except (ParseError, DefusedXmlException, ValueError, LookupError):
        return
    if found:
        raise MapError(shown_source, f"{ALLOWED} ({found})")


def _of_sumo_net(net: Element) -> str:
    return "lefthand of its net" if net.get("lefthand", "").lower() in {"true", "1", "yes"} else ""


def _of_opendrive(drive: Element) -> str:
    left = (road for road in drive.iterfind("road") if road.get("rule", "RHT").upper() == "LHT")
    return next((f'rule="LHT" of road {road.get("id", "")}' for road in left), "")


def _of_openstreetmap(osm: Element) -> str:
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
    return sum(
        (lon * to_lat - to_lon * lat) / 2.0
        for (lat, lon), (to_lat, to_lon) in zip(points, [*points[1:], *points[:1]], strict=True)
    )


_EVIDENCE: Final = {
    SourceKind.SUMO: _of_sumo_net,
    SourceKind.OPENDRIVE: _of_opendrive,
    SourceKind.OPENSTREETMAP: _of_openstreetmap,
}
"""What shows that a map's traffic keeps left, in words; an empty text where nothing does."""
