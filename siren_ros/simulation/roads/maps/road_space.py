"""Opens space beside the right lane of roads to emergency vehicles: shoulders, parking lanes, cycle lanes, wide lanes.

They drive past a queue there, and turn right. A map has such a lane, or the tags of an OpenStreetMap extract tell of
one, or the right lane is wide enough for a queue and an ambulance beside it.
"""

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Final
from xml.etree.ElementTree import Element, SubElement

from defusedxml.ElementTree import fromstring

from siren_ros.base.numerics.geometry import Polyline
from siren_ros.simulation.roads.maps.map_compiler import AMENDED, CompiledMap, changed_map, converted
from siren_ros.simulation.roads.maps.map_formats import OPEN_SHOULDER_WIDTH_M, mirrored_net, shoulder_movements, tags_of
from siren_ros.simulation.roads.maps.map_source import SourceKind, read_map_source
from siren_ros.simulation.roads.maps.netconvert import (
    document,
    insert_lane,
    mended_lanes,
    normal_edges,
    points_of,
    renumber_lanes,
    text_of,
)
from siren_ros.simulation.roads.net_parser import DEFAULT_LANE_WIDTH_M, is_left_hand, permissions_on
from siren_ros.simulation.roads.road_network import OTHER_SIDE
from siren_ros.simulation.roads.routing import TOWN_LIMIT_MPS

SPACES: Final[Mapping[str, str]] = {
    "shoulder": "shoulder",
    "parking_lane": "parking",
    "cycle_lane": "biking",
    "wide_lane": "",
}
"""The kinds of space, with OpenDRIVE's type of such lanes."""
_TAGS: Final[Mapping[str, tuple[tuple[str, ...], frozenset[str], float]]] = {
    "shoulder": (("shoulder",), frozenset({"yes", "both"}), 2.5),
    "parking_lane": (("parking", "parking:lane"), frozenset({"lane", "parallel", "diagonal", "perpendicular"}), 2.0),
    "cycle_lane": (("cycleway",), frozenset({"lane"}), 1.85),
}
"""Keys of OpenStreetMap, their values for a lane beside the right one, and the usual width of it in metres (RAL 2012;
RASt 06 for parking along the road, and for cycle lanes with their marking)."""
_AMBULANCE_M: Final = 2.1 + 2 * 0.2
"""Width for an ambulance: its own, and the clearance of its corridor on both sides."""
_QUEUE_M: Final = 2.55
"""Width for the queue beside it: that of the widest vehicles (Directive 96/53/EC)."""
_MOTORWAY_M: Final = 3.75
"""Width of a lane of a motorway (RAA 2008), that of the built-in one."""
_WAY: Final = re.compile(r"-?(\d+)")


def with_space(compiled: CompiledMap, space: str, source: Path | None) -> CompiledMap:
    """The map with a kind of space (``SPACES``) open to emergency vehicles; the same map where it has none.

    ``source`` is the file of the map: an OpenStreetMap extract has tags.

    Raises:
        MapError: netconvert refuses the net.
        InputError: The cache folder cannot be written.
    """

    def changed(net: bytes) -> bytes:
        ways: Mapping[str, Mapping[str, str]] = {}
        if compiled.kind is SourceKind.OPENSTREETMAP and source is not None:
            osm = fromstring(read_map_source(source).content, forbid_dtd=True)
            ways = {way.get("id", ""): tags_of(way) for way in osm.iterfind("way")}
        return _opened(net, space, ways)

    return changed_map(compiled, f"space 3 {space}", changed, space)


def _opened(net: bytes, space: str, ways: Mapping[str, Mapping[str, str]], outer: str = "right") -> bytes:
    root = fromstring(net, forbid_dtd=True)
    if is_left_hand(root):
        return mirrored_net(_opened(mirrored_net(net), space, ways, "left"))
    opened, moved = set[tuple[str, int]](), dict[str, int]()
    for edge in normal_edges(root):
        name, count = edge.attrib["id"], len(edge.findall("lane"))
        way = _WAY.match(name)
        side = OTHER_SIDE[outer] if name.startswith("-") else outer
        number = _open_beside(root, edge, space, _usual_m(ways.get(way[1], {}) if way else {}, space, side))
        if number is not None:
            opened.add((name, number))
            moved |= {name: number} if len(edge.findall("lane")) > count else {}
    if not opened:
        return net
    renumber_lanes(root, moved)
    for movement, ends in [*shoulder_movements(root, opened, into_lanes=True)]:
        SubElement(root, "connection", {**movement.attrib, **ends}).attrib.pop("via", None)
    return _redrawn(root, space)


def _redrawn(net: Element, shown: str) -> bytes:
    """A net whose junctions netconvert draws anew, for the lanes that it now has."""
    return mended_lanes(converted(shown, AMENDED, {"--sumo-net-file": document(net)}))


def with_motorway_lanes(net: bytes) -> bytes:
    """The net with the lanes of motorways where it states no width of theirs, out of town on two lanes or more.

    netconvert's own lanes are as narrow as those of streets, without space for a rescue lane.
    """
    root = fromstring(net, forbid_dtd=True)
    if is_left_hand(root):
        return mirrored_net(with_motorway_lanes(mirrored_net(net)))
    for edge in normal_edges(root):
        lanes = [lane for lane in edge.findall("lane") if permissions_on(lane).civilian]
        fast = len(lanes) > 1 and float(lanes[-1].attrib["speed"]) > TOWN_LIMIT_MPS
        if fast and not any("width" in lane.attrib for lane in lanes):
            _grow(root, edge, len(lanes) * (_MOTORWAY_M - DEFAULT_LANE_WIDTH_M))
            for lane in lanes:
                lane.set("width", f"{_MOTORWAY_M:g}")
    return _redrawn(root, "motorway lanes")


def _grow(net: Element, edge: Element, wider_m: float) -> None:
    """Lets a road become wider on its right; netconvert draws the lanes on both sides of the line of some roads."""
    if edge.get("spreadType") != "center":
        return
    ends = (net.find(f"junction[@id='{edge.attrib[end]}']") for end in ("from", "to"))
    straight = " ".join(f"{node.attrib['x']},{node.attrib['y']}" for node in ends if node is not None)
    line = Polyline.through(points_of(edge.get("shape", straight))[:, :2])
    edge.set("shape", text_of(line.offset_points(line.arc_m, -0.5 * wider_m)))


def _open_beside(net: Element, edge: Element, space: str, stated_m: float) -> int | None:
    """Opens the space on the right of a road's right driving lane, and gives its lane number; None without one."""
    lanes = edge.findall("lane")
    first = next((number for number, lane in enumerate(lanes) if permissions_on(lane).civilian), None)
    if first is None:
        return None
    beside = lanes[first - 1] if first and _is_space(lanes[first - 1], space) else None
    width_m = max(stated_m, _width_m(beside) if beside is not None else 0.0)
    if space == "wide_lane" and _width_m(lanes[first]) >= _AMBULANCE_M + _QUEUE_M:
        width_m = _AMBULANCE_M
        lanes[first].set("width", f"{_width_m(lanes[first]) - width_m:g}")
    elif width_m >= OPEN_SHOULDER_WIDTH_M and beside is None:
        _grow(net, edge, width_m)
    if width_m < OPEN_SHOULDER_WIDTH_M:
        return None
    if beside is None:
        beside = Element("lane", {**lanes[first].attrib, "width": f"{width_m:g}"})
        insert_lane(edge, first, beside)
    beside.attrib.pop("disallow", None)
    beside.set("allow", "bicycle emergency" if space == "cycle_lane" else "emergency")
    beside.set("speed", lanes[first].attrib["speed"])
    return int(beside.attrib["index"])


def _usual_m(tags: Mapping[str, str], space: str, side: str) -> float:
    """The usual width of the space that tags state for a side of the way; 0 where they state none."""
    bases, values, usual_m = _TAGS.get(space, ((), frozenset(), 0.0))
    keys = (key for base in bases for key in (f"{base}:{side}", f"{base}:both", base))
    return usual_m if next((tags[key] for key in keys if key in tags), "") in values | {side} else 0.0


def _is_space(lane: Element, space: str) -> bool:
    open_to = permissions_on(lane)
    for_cycles = open_to.bicycle and not (open_to.any_motor or open_to.pedestrian)
    return lane.get("type") == SPACES[space] or (space == "cycle_lane" and for_cycles)


def _width_m(lane: Element) -> float:
    return float(lane.get("width", DEFAULT_LANE_WIDTH_M))
