"""The mirror image of a SUMO net, with traffic on the other side."""

from typing import Final
from xml.etree.ElementTree import Element

from defusedxml.ElementTree import fromstring

from siren_ros.simulation.roads.maps.netconvert import document
from siren_ros.simulation.roads.mirror_image import OTHER_SIDE, negated
from siren_ros.simulation.roads.net_parser import is_left_hand

_SHAPES: Final = ("shape", "outlineShape", "customShape")


def mirrored_net(net: bytes) -> bytes:
    """The image about the x axis of the ``map`` frame; its road network is ``mirrored_network`` of the net's.

    Numbers keep their digits, so the image of the image has the net's numbers.
    """
    root = fromstring(net, forbid_dtd=True)
    if is_left_hand(root):
        del root.attrib["lefthand"]
    else:
        root.set("lefthand", "true")
    location = root.find("location")
    if location is not None:
        _mirror_location(location)
    for element in root.iter():
        for name in _SHAPES:
            if name in element.attrib:
                element.set(name, " ".join(map(_mirrored_point, element.attrib[name].split())))
        if element.tag == "junction":
            element.set("y", negated(element.attrib["y"]))
        if element.tag == "connection" and "dir" in element.attrib:
            element.set("dir", OTHER_SIDE.get(element.attrib["dir"], element.attrib["dir"]))
    return document(root)


def _mirror_location(location: Element) -> None:
    """Mirrors the boundary and the offset. The projection stays that of the net."""
    location.set("netOffset", _mirrored_point(location.get("netOffset", "0,0")))
    west, south, east, north = location.get("convBoundary", "0,0,0,0").split(",")
    location.set("convBoundary", ",".join((west, negated(north), east, negated(south))))


def _mirrored_point(point: str) -> str:
    x, y, *rest = point.split(",")
    return ",".join((x, negated(y), *rest))
