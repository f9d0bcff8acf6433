"""Gives streets cycle lanes, in netconvert's plain XML: the built-in city is the built-in town with them.

A cycle lane lies between the sidewalk and the other lanes. Cyclists cross a junction in every direction that the street
has; at a signal they go with the vehicles of that direction.
"""

from collections.abc import Mapping
from typing import Final
from xml.etree.ElementTree import Element, SubElement

from defusedxml.ElementTree import fromstring

from siren_ros.simulation.roads.maps.netconvert import document

CYCLE_LANE: Final = {"index": "1", "allow": "bicycle", "width": "1.85", "type": "cycle"}
"""Attributes of a cycle lane. The width is the usual one (RASt 06: 1.85 m with its marking)."""
_STREETS: Final = frozenset({"arterial", "collector"})
"""Types of the streets that get cycle lanes; elsewhere cyclists ride with the other traffic."""


def with_cycle_lanes(files: Mapping[str, bytes]) -> Mapping[str, bytes]:
    """Plain XML files by netconvert's options, with cycle lanes on both sides of the larger streets.

    Each street has its sidewalk as lane 0.
    """
    roots = {option: fromstring(content) for option, content in files.items()}
    edges, movements, signals = (roots[f"--{kind}-files"] for kind in ("edge", "connection", "tllogic"))
    widened = {edge.attrib["id"] for edge in edges.iterfind("edge") if edge.get("type") in _STREETS}
    for edge in edges.iterfind("edge"):
        if edge.attrib["id"] in widened:
            _add_lane(edge)
    for part in (movements, signals):
        _lead_across(part, widened)
    return {option: document(root) for option, root in roots.items()}


def _add_lane(edge: Element) -> None:
    lanes = edge.findall("lane")
    for lane in lanes[1:]:
        lane.set("index", str(int(lane.attrib["index"]) + 1))
    edge.insert(1, Element("lane", CYCLE_LANE))
    edge.set("numLanes", str(len(lanes) + 1))


def _lead_across(part: Element, widened: set[str]) -> None:
    """Moves the lane numbers of the movements by one, and adds the movements of cyclists.

    Each has the signal of its direction's last lane.
    """
    ways: dict[tuple[str, str], Element] = {}
    for movement in part.findall("connection"):
        pair = movement.attrib["from"], movement.attrib["to"]
        for edge, lane in zip(pair, ("fromLane", "toLane"), strict=True):
            if edge in widened and movement.attrib[lane] != "0":
                movement.set(lane, str(int(movement.attrib[lane]) + 1))
        if movement.attrib["fromLane"] != "0" and not widened.isdisjoint(pair):
            ways[pair] = movement
    for movement in ways.values():
        SubElement(part, "connection", {**movement.attrib, "fromLane": "1", "toLane": "1"})
