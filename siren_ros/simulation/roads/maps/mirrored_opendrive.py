"""The mirror image of an OpenDRIVE map about its x axis, with traffic on the other side.

netconvert takes the lanes on the right of a road as those in its direction, also where traffic keeps left (ASAM
OpenDRIVE 1.7, 10.3, attribute ``rule``: there they are the lanes on the left).
"""

from collections.abc import Mapping
from itertools import chain
from typing import Final
from xml.etree.ElementTree import Element

from defusedxml.ElementTree import fromstring

from siren_ros.simulation.roads.maps.netconvert import document
from siren_ros.simulation.roads.mirror_image import OTHER_SIDE, negated

_ABCD: Final = ("a", "b", "c", "d")
_NEGATED: Final[Mapping[str, tuple[str, ...]]] = {
    "geometry": ("y", "hdg"),
    "arc": ("curvature",),
    "spiral": ("curvStart", "curvEnd"),
    "poly3": _ABCD,
    "paramPoly3": ("aV", "bV", "cV", "dV"),
    "laneOffset": _ABCD,
    "superelevation": _ABCD,
    "signal": ("t", "hOffset", "roll"),
    "signalReference": ("t",),
    "object": ("t", "hdg", "roll"),
    "repeat": ("tStart", "tEnd"),
    "cornerRoad": ("t",),
    "cornerLocal": ("v",),
    "laneLink": ("from", "to"),
}
"""By element, the attributes that change sign in the mirror image: numbers that are positive to the left or
counter-clockwise, and lane numbers."""
_ORDER: Final = ("left", "center", "right")


def mirrored_opendrive(xodr: bytes) -> bytes:
    """The image; what the map says of its place on Earth stays.

    Raises:
        ValueError, LookupError: The map is damaged.
    """
    drive = fromstring(xodr, forbid_dtd=True)
    for road in drive.iterfind("road"):
        road.set("rule", "RHT" if road.get("rule", "RHT").upper() == "LHT" else "LHT")
        for section in road.iter("laneSection"):
            _mirror_section(section)
        for validity in road.iter("validity"):
            first, last = (str(-int(validity.attrib[name])) for name in ("toLane", "fromLane"))
            validity.attrib.update(fromLane=first, toLane=last)
    for element in drive.iter():
        for name in _NEGATED.get(element.tag, ()):
            if name in element.attrib:
                element.set(name, negated(element.attrib[name]))
    return document(drive)


def _mirror_section(section: Element) -> None:
    """Exchanges the sides of a lane section.

    Lanes are listed from left to right, so those with the largest number come first.
    """
    for side in section:
        side.tag = OTHER_SIDE.get(side.tag, side.tag)
        lanes = side.findall("lane")
        for lane in lanes:
            links = (lane.find("link/predecessor"), lane.find("link/successor"))
            for numbered in chain((lane,), (link for link in links if link is not None)):
                numbered.set("id", str(-int(numbered.attrib["id"])))
            side.remove(lane)
        side.extend(sorted(lanes, key=lambda lane: -int(lane.attrib["id"])))
    ordered = sorted(section, key=lambda side: _ORDER.index(side.tag) if side.tag in _ORDER else len(_ORDER))
    section[:] = ordered
