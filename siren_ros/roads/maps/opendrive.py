"""Adds what netconvert leaves out of an OpenDRIVE map: shoulders for the EMV, signs, and speed limits.

netconvert gives 50 km/h to all roads whose limit is that of their type.
"""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Final
from xml.etree.ElementTree import Element, ParseError, SubElement, tostring

from defusedxml import DefusedXmlException
from defusedxml.ElementTree import fromstring

from siren_ros.errors import MapError
from siren_ros.roads.maps.netconvert import control_patches, document, normal_edges
from siren_ros.roads.net_parser import paths_across, permissions_of

OPEN_SHOULDER_WIDTH_M: Final = 1.8
"""A shoulder this wide, right of the driving lanes, is opened to emergency vehicles; kerb strips are narrower."""
WALKING_SPEED_MPS: Final = 1.39
PLAIN_SIGN_REACH_M: Final = 15.0
"""A sign on a road binds the junction at the road's end when it stands at most this far from it."""

_MOTOR_TYPES: Final = frozenset({"driving", "entry", "exit", "offRamp", "onRamp", "connectingRamp", "bidirectional"})
_OPEN_TO_ALL_IN_NAME: Final = frozenset({"", "none"})
_STOP_SIGN: Final = "206"
"""German sign catalogue (StVO), which RoadRunner's OpenDRIVE export uses: 206 stop, 205 give way."""
_YIELD_SIGN: Final = "205"


@dataclass(frozen=True)
class OpenDrivePatches:
    """Plain XML documents for netconvert's second run."""

    nodes: bytes
    edges: bytes
    connections: bytes


@dataclass(frozen=True)
class _Approach:
    """Traffic of one road that heads for a junction (SUMO keeps the junction's and the road's ids)."""

    road_id: str
    junction_id: str


def opendrive_patches(first_net: bytes, xodr: bytes, shown_source: str) -> OpenDrivePatches:
    """Patches for lane permissions, shoulder movements and sign-controlled junctions.

    Args:
        first_net: What netconvert's first run wrote, with all lane types imported.
        xodr: The OpenDRIVE map.
        shown_source: What an error names as the map.

    Raises:
        MapError: The OpenDRIVE document cannot be read.
    """
    try:
        drive = fromstring(xodr, forbid_dtd=True)
    except (ParseError, DefusedXmlException, ValueError, LookupError) as error:
        raise MapError(shown_source, f"an OpenDRIVE map that is well-formed XML ({error})") from error
    net = fromstring(first_net)
    try:
        stop = _signed_approaches(drive, _STOP_SIGN)
        yields = _signed_approaches(drive, _YIELD_SIGN)
    except (KeyError, ValueError) as error:
        raise MapError(shown_source, f"an OpenDRIVE map whose signs are complete ({error!r})") from error
    nodes, minor_edges = control_patches(net, _edges_of(net, stop), _edges_of(net, yields), _has_driving_lane)
    return OpenDrivePatches(
        nodes=document("nodes", nodes),
        edges=document("edges", _edge_patches(net, minor_edges)),
        connections=document("connections", _shoulder_connections(net)),
    )


def _signed_approaches(drive: Element, sign_type: str) -> tuple[_Approach, ...]:
    signals = {
        signal.attrib["id"] for signal in drive.iter("signal") if signal.get("type") == sign_type and signal.get("id")
    }
    found: dict[_Approach, None] = {}
    for road in drive.iterfind("road"):
        for sign in (*road.iter("signal"), *road.iter("signalReference")):
            if sign.get("id") in signals:
                approach = _approach_of(road, sign)
                if approach is not None:
                    found[approach] = None
    return tuple(found)


def _approach_of(road: Element, sign: Element) -> _Approach | None:
    """The road whose traffic passes a sign on the way into a junction.

    On a connecting road inside the junction, traffic in the direction of the road's reference line comes from its
    predecessor and traffic against it from its successor. On a road outside, the sign binds the junction ahead.
    """
    backward = sign.get("orientation") == "-"
    junction_id = road.get("junction", "-1")
    if junction_id != "-1":
        origin = road.find("link/successor" if backward else "link/predecessor")
        if origin is None or origin.get("elementType") != "road":
            return None
        return _Approach(origin.attrib["elementId"], junction_id)
    ahead = road.find("link/predecessor" if backward else "link/successor")
    if ahead is None or ahead.get("elementType") != "junction":
        return None
    s_m, length_m = float(sign.get("s", "0")), float(road.get("length", "0"))
    if (s_m if backward else length_m - s_m) > PLAIN_SIGN_REACH_M:
        return None
    return _Approach(road.attrib["id"], ahead.attrib["elementId"])


def _road_of_edge(edge_id: str) -> str:
    return edge_id.lstrip("-").partition(".")[0]


def _has_driving_lane(edge: Element) -> bool:
    return any(lane.get("type", "") in _MOTOR_TYPES for lane in edge.iterfind("lane"))


def _edges_of(net: Element, approaches: tuple[_Approach, ...]) -> frozenset[str]:
    """Ids of the edges that come from the approaches' roads to their junctions."""
    wanted = {(approach.road_id, approach.junction_id) for approach in approaches}
    edges = ((edge.attrib["id"], edge.attrib["to"]) for edge in normal_edges(net) if _has_driving_lane(edge))
    return frozenset(edge_id for edge_id, to in edges if (_road_of_edge(edge_id), to) in wanted)


def _open_shoulders(edge: Element) -> frozenset[int]:
    """Lane numbers of an edge's shoulders that the EMV may use."""
    lanes = edge.findall("lane")
    driving = [int(lane.attrib["index"]) for lane in lanes if lane.get("type", "") in _MOTOR_TYPES]
    return frozenset(
        int(lane.attrib["index"])
        for lane in lanes
        if lane.get("type") == "shoulder"
        and int(lane.attrib["index"]) < min(driving, default=0)
        and float(lane.get("width", "0")) >= OPEN_SHOULDER_WIDTH_M
    )


def _edge_patches(net: Element, priorities: Mapping[str, int]) -> Iterator[Element]:
    for edge in normal_edges(net):
        patch = Element("edge", id=edge.attrib["id"])
        if edge.attrib["id"] in priorities:
            patch.set("priority", str(priorities[edge.attrib["id"]]))
        lanes = edge.findall("lane")
        limits = [float(lane.get("speed", "0")) for lane in lanes if lane.get("type", "") in _MOTOR_TYPES]
        limit_mps = max(limits, default=WALKING_SPEED_MPS)
        shoulders = _open_shoulders(edge)
        for lane in lanes:
            lane_type = lane.get("type", "")
            if lane_type in _MOTOR_TYPES or lane_type in _OPEN_TO_ALL_IN_NAME:
                continue
            change = SubElement(patch, "lane", index=lane.attrib["index"])
            if lane_type == "sidewalk":
                change.set("allow", "pedestrian")
                change.set("speed", str(WALKING_SPEED_MPS))
            elif int(lane.attrib["index"]) in shoulders:
                change.set("allow", "emergency")
                change.set("speed", str(limit_mps))
            else:
                change.set("disallow", "all")
        yield patch


def _shoulder_connections(net: Element) -> Iterator[Element]:
    """Movements from shoulder to shoulder, parallel to each straight or right movement of the lane on their left."""
    shoulders = {(edge.attrib["id"], index) for edge in normal_edges(net) for index in _open_shoulders(edge)}
    movements = [
        (c.attrib["from"], int(c.attrib["fromLane"]), c.attrib["to"], int(c.attrib["toLane"]), c.get("dir", ""))
        for c in net.iterfind("connection")
        if not c.attrib["from"].startswith(":")
    ]
    present = {movement[:4] for movement in movements}
    for source, from_lane, target, to_lane, direction in movements:
        if direction not in {"s", "r", "R"} or (source, from_lane - 1, target, to_lane - 1) in present:
            continue
        if (source, from_lane - 1) in shoulders and (target, to_lane - 1) in shoulders:
            yield Element(
                "connection",
                {"from": source, "to": target, "fromLane": str(from_lane - 1), "toLane": str(to_lane - 1)},
            )


_NETCONVERT_MPS: Final = 13.89
_SAME_MPS: Final = 0.01
_UNIT_MPS: Final[Mapping[str, float]] = {"m/s": 1.0, "km/h": 1.0 / 3.6, "mph": 0.44704}


def with_stated_limits(net_xml: bytes, xodr: bytes) -> bytes:
    """The net with the limits of the map's road types; limits of single lanes are netconvert's to read.

    Paths across junctions get the lower limit of the lanes that they join. Where netconvert slowed them down for a
    turn, they stay so.

    Args:
        net_xml: A net made from the map.
        xodr: The OpenDRIVE map.
    """
    limits = _limits_mps(fromstring(xodr, forbid_dtd=True))
    net = fromstring(net_xml, forbid_dtd=True)
    speeds: dict[str, float] = {}
    for edge in normal_edges(net):
        limit_mps = limits.get(edge.attrib["id"].lstrip("-").partition(".")[0])
        for lane in edge.iterfind("lane"):
            if limit_mps is not None and _has_default(lane):
                lane.set("speed", f"{limit_mps:.2f}")
            speeds[lane.attrib["id"]] = float(lane.get("speed", "0"))
    across = {lane.attrib["id"]: lane for lane in net.iter("lane") if lane.attrib["id"].startswith(":")}
    for movement in paths_across(net):
        slower_mps = min(speeds.get(one, math.inf) for one in (movement.source, movement.target))
        for path in (across[lane] for lane in movement.via if lane in across):
            if _has_default(path):
                path.set("speed", f"{slower_mps:.2f}")
    document: bytes = tostring(net, encoding="utf-8", xml_declaration=True)
    return document


def _has_default(lane: Element) -> bool:
    allowed = permissions_of(lane.get("allow"), lane.get("disallow"))
    driven = allowed.civilian or allowed.emergency
    return driven and abs(float(lane.get("speed", "0")) - _NETCONVERT_MPS) < _SAME_MPS


def _limits_mps(drive: Element) -> dict[str, float]:
    """Limit of each road by id: of several along it, the one that holds for the longest part."""
    found: dict[str, float] = {}
    for road in drive.iterfind("road"):
        kinds = sorted(road.iterfind("type"), key=_start_m)
        ends = [*(_start_m(kind) for kind in kinds), float(road.get("length", "0"))]
        parts = [(end - start, kind) for kind, (start, end) in zip(kinds, pairwise(ends), strict=True)]
        stated = [(length_m, _speed_mps(kind.find("speed"))) for length_m, kind in parts]
        known = [(length_m, speed) for length_m, speed in stated if speed is not None]
        if known:
            found[road.attrib["id"]] = max(known)[1]
    return found


def _start_m(kind: Element) -> float:
    return float(kind.get("s", "0"))


def _speed_mps(speed: Element | None) -> float | None:
    """A ``speed`` element in m/s; None without a number (``no limit``, ``undefined``)."""
    if speed is None:
        return None
    try:
        value = float(speed.get("max", "")) * _UNIT_MPS.get(speed.get("unit", "m/s"), math.nan)
    except ValueError:
        return None
    return value if math.isfinite(value) and value > 0.0 else None
