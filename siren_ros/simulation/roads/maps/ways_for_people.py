"""Adds the ways for pedestrians and cyclists where an episode has some; maps of other episodes stay as they are.

Sidewalks get corners where they meet. Crossings join the sidewalks of both sides of a street at its junctions: in an
OpenDRIVE map at those that have crosswalks, elsewhere at all. OpenStreetMap's own crossings come on top.
"""

import re
from collections.abc import Iterator
from typing import Final
from xml.etree.ElementTree import Element

from defusedxml.ElementTree import fromstring

from siren_ros.simulation.roads.maps.map_source import MapSource, SourceKind
from siren_ros.simulation.roads.maps.netconvert import normal_edges, sumo_home

_TYPES: Final = ("osmNetconvert", "osmNetconvertBicycle")
_SEPARATE: Final = re.compile(rb"""(k=["']sidewalk(:both|:left|:right)?["']\s+v=["'])separate(["'])""")
"""Finds a sidewalk that is also drawn as a way of its own. netconvert drops such ways where it keeps streets alone."""
_LEAST_ARMS: Final = 3
_OUTLINE: Final = re.compile(rb' outlineShape="[^"]*"')


def cycle_options() -> tuple[str, ...]:
    """Netconvert's options for an OpenStreetMap extract with its cycle lanes and its crossings."""
    types = ",".join(str(sumo_home() / "data/typemap" / f"{name}.typ.xml") for name in _TYPES)
    return "--type-files", types, "--osm.bike-access", "--osm.crossings"


def with_sidewalks_on_streets(osm: bytes) -> bytes:
    """An OpenStreetMap extract in which separately drawn sidewalks belong to their streets."""

    def on_street(tag: "re.Match[bytes]") -> bytes:
        return tag[1] + (b"yes" if tag[2] else b"both") + tag[3]

    return _SEPARATE.sub(on_street, osm)


def has_corners(net: bytes) -> bool:
    """Whether the sidewalks of a net meet at junctions."""
    return b'function="walkingarea"' in net


def without_outlines(net: bytes) -> bytes:
    """A net with crossings as wide as their lanes. netconvert's own outlines extend around corners of sidewalks."""
    return _OUTLINE.sub(b"", net)


def real_junctions(net: Element) -> frozenset[str]:
    """Junctions of three streets or more, and places that have crossings already."""
    arms: dict[str, set[str]] = {}
    for edge in normal_edges(net):
        ends = edge.attrib["from"], edge.attrib["to"]
        for end, other in (ends, ends[::-1]):
            arms.setdefault(end, set()).add(other)
    crossed = {edge.attrib["id"][1:].rpartition("_")[0] for edge in net.iterfind("edge[@function='crossing']")}
    return frozenset(crossed.union(node for node, others in arms.items() if len(others) >= _LEAST_ARMS))


def crosswalk_junctions(drive: Element) -> frozenset[str]:
    """Junctions of an OpenDRIVE map with a crosswalk: on a road across the junction, or near the end of a road."""
    found: set[str] = set()
    for road in drive.iterfind("road"):
        for crosswalk in road.iterfind("objects/object[@type='crosswalk']"):
            at_end = 2.0 * float(crosswalk.get("s", "0")) > float(road.get("length", "0"))
            link = road.find("link/successor" if at_end else "link/predecessor")
            if road.get("junction", "-1") != "-1":
                found.add(road.attrib["junction"])
            elif link is not None and link.get("elementType") == "junction":
                found.add(link.attrib["elementId"])
    return frozenset(found)


def crossing_places(source: MapSource, net: Element) -> Iterator[Element]:
    """Elements of netconvert's plain XML that forbid crossings at all places but those of the map."""
    drive = source.kind is SourceKind.OPENDRIVE
    kept = crosswalk_junctions(fromstring(source.content, forbid_dtd=True)) if drive else real_junctions(net)
    nodes = (junction.attrib["id"] for junction in net.iterfind("junction") if junction.get("type") != "internal")
    return (Element("crossing", node=node, discard="true") for node in nodes if node not in kept)
