"""Changes an OpenDRIVE map so that netconvert accepts it.

netconvert refuses a whole map for one signal that lacks a type, and for a direct junction. In a direct junction (ASAM
OpenDRIVE 1.6, 10.4) one road ends where several begin, such as a carriageway and its exit, and lanes are linked without
roads between them. It becomes a common junction: for each direction of a connection, a connecting road with the
linked lanes stands at the place where the roads meet. netconvert draws the paths across junctions itself; from these
roads it takes the place and the links of lanes.
"""

from collections.abc import Iterator, Mapping, Sequence
from typing import Final, NamedTuple
from xml.etree.ElementTree import Element, SubElement

import numpy as np
from defusedxml.ElementTree import fromstring

from siren_ros.simulation.roads.maps.netconvert import document

_SIGNAL: Final = {"type": "-1", "dynamic": "no", "orientation": "none"}
"""What an attribute of a signal that netconvert requires says where the map leaves it out or empty."""
_SIGNAL_NEEDS: Final = ("id", "s")
_CONNECTING_M: Final = 0.1
"""Length of a connecting road: the roads that it connects touch."""
_PIECES: Final = 1000
"""Pieces in which the heading along a curve is added up."""


class _End(NamedTuple):
    """The end of a road at a junction."""

    road: Element
    contact: str
    """``start`` or ``end``."""

    @property
    def lanes(self) -> Mapping[str, Element]:
        """The road's lanes there, by their numbers."""
        sections = self.road.findall("lanes/laneSection")
        section = sections[0 if self.contact == "start" else -1]
        return {lane.get("id", ""): lane for lane in section.iter("lane")}

    def leads_in(self, lane: str) -> bool:
        """Whether a lane's traffic, which keeps right, drives from here into the junction."""
        return (int(lane) < 0) == (self.contact == "end")


def importable(xodr: bytes) -> bytes:
    """The map with complete signals, and with common junctions in place of direct ones; unchanged without such.

    Traffic must keep right in it.

    Raises:
        ValueError, LookupError: The map is damaged.
    """
    drive = fromstring(xodr, forbid_dtd=True)
    direct = drive.findall("junction[@type='direct']")
    changed = _complete_signals(drive)
    if not direct and not changed:
        return xodr
    roads = {road.attrib["id"]: road for road in drive.iterfind("road")}
    for junction in direct:
        for number, road in enumerate(_made_common(junction, roads)):
            drive.insert(number, road)
    return document(drive)


def _complete_signals(drive: Element) -> bool:
    """Completes signals in place, and drops those without name or place; whether any was incomplete."""
    changed = False
    for signals in drive.iter("signals"):
        for signal in signals.findall("signal"):
            lacking = {name: value for name, value in _SIGNAL.items() if not signal.get(name)}
            signal.attrib.update(lacking)
            if unusable := not all(signal.get(name) for name in _SIGNAL_NEEDS):
                signals.remove(signal)
            changed |= bool(lacking) or unusable
    return changed


def _made_common(junction: Element, roads: Mapping[str, Element]) -> Iterator[Element]:
    """Makes a direct junction a common one in place, and gives the connecting roads that it then has."""
    connections = junction.findall("connection")
    junction.attrib.pop("type")
    for connection in connections:
        junction.remove(connection)
    for connection in connections:
        incoming = roads[connection.attrib["incomingRoad"]]
        successor = incoming.find("link/successor[@elementType='junction']")
        at_end = successor is not None and successor.get("elementId") == junction.get("id")
        ends = (
            _End(incoming, "end" if at_end else "start"),
            _End(roads[connection.attrib["linkedRoad"]], connection.get("contactPoint", "start")),
        )
        pairs = [(link.attrib["from"], link.attrib["to"]) for link in connection.iterfind("laneLink")]
        there = [pair for pair in pairs if ends[0].leads_in(pair[0])]
        back = [pair[::-1] for pair in pairs if not ends[0].leads_in(pair[0])]
        for (source, target), lanes in ((ends, there), (ends[::-1], back)):
            if lanes:
                name = f"{junction.get('id')}direct{len(junction)}"
                yield _connecting_road(
                    junction, name, source, target, sorted(lanes, key=lambda pair: abs(int(pair[0])))
                )


def _connecting_road(
    junction: Element, name: str, source: _End, target: _End, lanes: Sequence[tuple[str, str]]
) -> Element:
    """A road in a junction from one end of a road to another, with a lane for each pair of lanes, inner lanes first."""
    number = {"id": str(len(junction)), "incomingRoad": source.road.attrib["id"], "connectingRoad": name}
    connection = SubElement(junction, "connection", {**number, "contactPoint": "start"})
    road = Element("road", {"id": name, "length": str(_CONNECTING_M), "junction": junction.attrib["id"]})
    link = SubElement(road, "link")
    for tag, end in (("predecessor", source), ("successor", target)):
        ends = {"elementType": "road", "elementId": end.road.attrib["id"], "contactPoint": end.contact}
        SubElement(link, tag, ends)
    place = dict(zip(("x", "y", "hdg"), map(str, _place_of(source, target)), strict=True))
    geometry = SubElement(SubElement(road, "planView"), "geometry", {"s": "0", **place, "length": str(_CONNECTING_M)})
    SubElement(geometry, "line")
    section = SubElement(SubElement(road, "lanes"), "laneSection", {"s": "0"})
    SubElement(SubElement(section, "center"), "lane", {"id": "0", "type": "none", "level": "false"})
    right = SubElement(section, "right")
    for place_from_middle, (before, after) in enumerate(lanes, start=1):
        here = str(-place_from_middle)
        kind = source.lanes[before].get("type", "driving")
        lane = SubElement(right, "lane", {"id": here, "type": kind, "level": "false"})
        links = SubElement(lane, "link")
        SubElement(links, "predecessor", {"id": before})
        SubElement(links, "successor", {"id": after})
        SubElement(lane, "width", {"sOffset": "0", "a": "3.5", "b": "0", "c": "0", "d": "0"})
        SubElement(connection, "laneLink", {"from": before, "to": here})
    return road


def _place_of(source: _End, target: _End) -> tuple[float, float, float]:
    """x, y and heading into the second road where two roads meet: at a road's start as it is stated, else computed."""
    for end in (target, source):
        first = end.road.find("planView/geometry")
        if first is not None and end.contact == "start":
            x, y, hdg = (float(first.get(name, "0")) for name in ("x", "y", "hdg"))
            return x, y, hdg if end is target else hdg + np.pi
    x, y, hdg = _end_of(target.road.findall("planView/geometry")[-1])
    return x, y, hdg + np.pi


def _end_of(geometry: Element) -> tuple[float, float, float]:
    """x, y and heading at the end of a piece of a road's reference line."""

    def number(element: Element, name: str) -> float:
        return float(element.get(name, "0"))

    shape, length_m = geometry[0], number(geometry, "length")
    if shape.tag in {"paramPoly3", "poly3"}:
        end = length_m if shape.tag == "poly3" or shape.get("pRange") == "arcLength" else 1.0
        along, across = ("aU", "bU", "cU", "dU"), ("aV", "bV", "cV", "dV")
        u, du = (end, 1.0) if shape.tag == "poly3" else _polynomial([number(shape, name) for name in along], end)
        v, dv = _polynomial([number(shape, name[0] if shape.tag == "poly3" else name) for name in across], end)
        turned = float(np.arctan2(dv, du))
    else:
        first, last = (number(shape, name) for name in ("curvStart", "curvEnd"))
        if shape.tag == "arc":
            first = last = number(shape, "curvature")
        s_m = (np.arange(_PIECES) + 0.5) * length_m / _PIECES
        heading = first * s_m + (last - first) * s_m**2 / (2.0 * max(length_m, 1e-9))
        u, v = (float(part.mean()) * length_m for part in (np.cos(heading), np.sin(heading)))
        turned = 0.5 * (first + last) * length_m
    hdg = number(geometry, "hdg")
    cos, sin = np.cos(hdg), np.sin(hdg)
    return number(geometry, "x") + cos * u - sin * v, number(geometry, "y") + sin * u + cos * v, hdg + turned


def _polynomial(factors: Sequence[float], at: float) -> tuple[float, float]:
    """A cubic polynomial's value and slope."""
    a, b, c, d = factors
    return a + at * (b + at * (c + at * d)), b + at * (2.0 * c + 3.0 * d * at)
