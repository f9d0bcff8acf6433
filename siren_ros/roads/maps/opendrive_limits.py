"""Speed limits of an OpenDRIVE map. netconvert gives 50 km/h to all roads whose limit is that of their type."""

import math
from collections.abc import Mapping
from itertools import pairwise
from typing import Final
from xml.etree.ElementTree import Element, tostring

from defusedxml.ElementTree import fromstring

from siren_ros.roads.junction_lanes import paths_across
from siren_ros.roads.lane_permissions import permissions_of
from siren_ros.roads.maps.junction_control import normal_edges

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
