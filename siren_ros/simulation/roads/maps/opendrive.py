"""Adds what netconvert leaves out of an OpenDRIVE map: shoulders for the EMV, stop and yield signs, speed limits.

netconvert is run twice. The first run imports the roads; its lanes of every type but ``driving`` get permissions that
do not fit (a sidewalk is open to cars, a shoulder to nobody), and signs are dropped. The patches made here are
netconvert's own plain XML, which the second run applies to the first run's net. netconvert gives 50 km/h to all roads
whose limit is that of their type; their limits are set in the second run's net.
"""

import math
from collections.abc import Iterator, Mapping
from itertools import pairwise
from typing import Final
from xml.etree.ElementTree import Element, ParseError, SubElement

from defusedxml import DefusedXmlException
from defusedxml.ElementTree import fromstring

from siren_ros.errors import MapError
from siren_ros.simulation.roads.maps.netconvert import control_patches, document, normal_edges
from siren_ros.simulation.roads.net_parser import paths_across, permissions_on

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
_NETCONVERT_MPS: Final = 13.89
_SAME_MPS: Final = 0.01
_UNIT_MPS: Final[Mapping[str, float]] = {"m/s": 1.0, "km/h": 1.0 / 3.6, "mph": 0.44704}


def opendrive_patches(
    first_net: bytes, xodr: bytes, shown_source: str, *, for_people: bool = False
) -> dict[str, bytes]:
    """Patches for lane permissions, shoulder movements and sign-controlled junctions.

    ``first_net`` is what netconvert's first run wrote, with all lane types imported; cycle lanes open ``for_people``.

    Returns:
        Plain XML documents for netconvert's second run, by the option that names the document.

    Raises:
        MapError: The OpenDRIVE document cannot be read.
    """
    try:
        drive = fromstring(xodr, forbid_dtd=True)
    except (ParseError, DefusedXmlException, ValueError, LookupError) as error:
        raise MapError(shown_source, f"an OpenDRIVE map that is well-formed XML ({error})") from error
    net = fromstring(first_net)
    try:
        stopping, yielding = (_signed_edges(net, drive, sign_type) for sign_type in (_STOP_SIGN, _YIELD_SIGN))
    except (KeyError, ValueError) as error:
        raise MapError(shown_source, f"an OpenDRIVE map whose signs are complete ({error!r})") from error
    nodes, priorities = control_patches(net, stopping, yielding, lambda edge: bool(_motor_lanes(edge)))
    return {
        "--node-files": document("nodes", nodes),
        "--edge-files": document("edges", _edge_patches(net, priorities, for_people=for_people)),
        "--connection-files": document("connections", _shoulder_connections(net)),
    }


def _signed_edges(net: Element, drive: Element, sign_type: str) -> frozenset[str]:
    """Ids of the edges whose traffic passes a sign of a type on the way into a junction."""
    signals = {signal.get("id") for signal in drive.iter("signal") if signal.get("type") == sign_type} - {None, ""}
    approaches = {
        _approach_of(road, sign)
        for road in drive.iterfind("road")
        for sign in (*road.iter("signal"), *road.iter("signalReference"))
        if sign.get("id") in signals
    }
    edges = filter(_motor_lanes, normal_edges(net))
    return frozenset(edge.attrib["id"] for edge in edges if (_road_of(edge), edge.attrib["to"]) in approaches)


def _approach_of(road: Element, sign: Element) -> tuple[str, str] | None:
    """The road from which a sign's traffic enters a junction, and that junction. SUMO keeps the ids of both.

    On a connecting road inside the junction, traffic in the direction of the road's reference line comes from its
    predecessor and traffic against it from its successor. On a road outside, the sign binds the junction ahead.
    """
    backward, junction = sign.get("orientation") == "-", road.get("junction", "-1")
    inside = junction != "-1"
    link = road.find("link/successor" if backward == inside else "link/predecessor")
    if link is None or link.get("elementType") != ("road" if inside else "junction"):
        return None
    if inside:
        return link.attrib["elementId"], junction
    s_m, length_m = float(sign.get("s", "0")), float(road.get("length", "0"))
    if (s_m if backward else length_m - s_m) > PLAIN_SIGN_REACH_M:
        return None
    return road.attrib["id"], link.attrib["elementId"]


def _road_of(edge: Element) -> str:
    return edge.attrib["id"].lstrip("-").partition(".")[0]


def _motor_lanes(edge: Element) -> list[Element]:
    return [lane for lane in edge.iterfind("lane") if lane.get("type", "") in _MOTOR_TYPES]


def _open_shoulders(edge: Element) -> frozenset[int]:
    """Lane numbers of an edge's shoulders that the EMV may use."""
    first = min((int(lane.attrib["index"]) for lane in _motor_lanes(edge)), default=0)
    return frozenset(
        int(lane.attrib["index"])
        for lane in edge.iterfind("lane[@type='shoulder']")
        if int(lane.attrib["index"]) < first and float(lane.get("width", "0")) >= OPEN_SHOULDER_WIDTH_M
    )


def _edge_patches(net: Element, priorities: Mapping[str, int], *, for_people: bool) -> Iterator[Element]:
    for edge in normal_edges(net):
        patch = Element("edge", id=edge.attrib["id"])
        if edge.attrib["id"] in priorities:
            patch.set("priority", str(priorities[edge.attrib["id"]]))
        limit_mps = max((float(lane.get("speed", "0")) for lane in _motor_lanes(edge)), default=WALKING_SPEED_MPS)
        shoulders = _open_shoulders(edge)
        for lane in edge.iterfind("lane"):
            lane_type = lane.get("type", "")
            if lane_type in _MOTOR_TYPES or lane_type in _OPEN_TO_ALL_IN_NAME:
                continue
            change = {"disallow": "all"}
            if lane_type == "sidewalk":
                change = {"allow": "pedestrian", "speed": str(WALKING_SPEED_MPS)}
            elif for_people and lane_type == "biking":
                change = {"allow": "bicycle"}
            elif int(lane.attrib["index"]) in shoulders:
                change = {"allow": "emergency", "speed": str(limit_mps)}
            SubElement(patch, "lane", {"index": lane.attrib["index"], **change})
        yield patch


def _shoulder_connections(net: Element) -> Iterator[Element]:
    """Movements from shoulder to shoulder, parallel to each straight or right movement of the lane on their left."""
    shoulders = {(edge.attrib["id"], index) for edge in normal_edges(net) for index in _open_shoulders(edge)}
    directions = {
        ((c.attrib["from"], int(c.attrib["fromLane"])), (c.attrib["to"], int(c.attrib["toLane"]))): c.get("dir", "")
        for c in net.iterfind("connection")
        if not c.attrib["from"].startswith(":")
    }
    for ((source, from_lane), (target, to_lane)), direction in directions.items():
        beside = (source, from_lane - 1), (target, to_lane - 1)
        if direction in {"s", "r", "R"} and beside not in directions and shoulders.issuperset(beside):
            ends = {"from": source, "to": target, "fromLane": str(from_lane - 1), "toLane": str(to_lane - 1)}
            yield Element("connection", ends)


def with_stated_limits(net_xml: bytes, xodr: bytes) -> bytes:
    """The net with the speed limits of the map's road types. netconvert itself reads limits of single lanes.

    Paths across junctions get the lower limit of the lanes that they join. Where netconvert slowed them down for a
    turn, they stay so.
    """
    drive, net = fromstring(xodr, forbid_dtd=True), fromstring(net_xml, forbid_dtd=True)
    limits = {road.attrib["id"]: limit for road in drive.iterfind("road") if (limit := _limit_mps(road)) is not None}
    speeds: dict[str, float] = {}
    for edge in normal_edges(net):
        for lane in edge.iterfind("lane"):
            if _road_of(edge) in limits and _has_default(lane):
                lane.set("speed", f"{limits[_road_of(edge)]:.2f}")
            speeds[lane.attrib["id"]] = float(lane.get("speed", "0"))
    across = {lane.attrib["id"]: lane for lane in net.iter("lane") if lane.attrib["id"].startswith(":")}
    for movement in paths_across(net):
        slower_mps = min(speeds.get(lane_id, math.inf) for lane_id in (movement.source, movement.target))
        for lane_id in movement.via:
            if lane_id in across and _has_default(across[lane_id]):
                across[lane_id].set("speed", f"{slower_mps:.2f}")
    return document(net)


def _has_default(lane: Element) -> bool:
    permissions = permissions_on(lane)
    is_driven = permissions.civilian or permissions.emergency
    return is_driven and abs(float(lane.get("speed", "0")) - _NETCONVERT_MPS) < _SAME_MPS


def _limit_mps(road: Element) -> float | None:
    """The limit of a road: of several along it, the one that holds for the longest part; None without one."""
    types = [(float(kind.get("s", "0")), _speed_mps(kind.find("speed"))) for kind in road.iterfind("type")]
    types.sort(key=lambda entry: entry[0])
    ends = pairwise([*(start_m for start_m, _ in types), float(road.get("length", "0"))])
    known = [(end - start, speed) for (start, end), (_, speed) in zip(ends, types, strict=True) if speed is not None]
    return max(known)[1] if known else None


def _speed_mps(speed: Element | None) -> float | None:
    """A ``speed`` element in m/s; None without a number (``no limit``, ``undefined``)."""
    if speed is None:
        return None
    try:
        value = float(speed.get("max", "")) * _UNIT_MPS.get(speed.get("unit", "m/s"), math.nan)
    except ValueError:
        return None
    return value if math.isfinite(value) and value > 0.0 else None
