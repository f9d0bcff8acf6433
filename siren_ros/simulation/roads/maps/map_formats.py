"""OpenDRIVE and OpenStreetMap: what netconvert leaves out of such maps, and mirror images of maps.

OpenDRIVE: shoulders for the EMV, stop and yield signs, speed limits. netconvert is run twice. The first run imports the
roads; its lanes of every type but ``driving`` get permissions that do not fit (a sidewalk is open to cars, a shoulder
to nobody), and signs are dropped. The patches made here are netconvert's own plain XML, which the second run applies to
the first run's net. netconvert gives 50 km/h to all roads whose limit is that of their type; their limits are set in
the second run's net.

OpenStreetMap: stop and give-way signs, and room where lanes fan out. A sign is a node of a way, ``highway=stop`` or
``highway=give_way``, shortly before a junction. Its ``direction`` (``forward``, ``backward``, ``both``) says for which
traffic it stands; without one it stands for traffic towards the nearer junction. At the junction's own node it binds
all approaches (``stop=all``), as mappers draw all-way stops.
Source: https://wiki.openstreetmap.org/wiki/Tag:highway=stop.

The mirror image of a SUMO net or of an OpenDRIVE map has traffic on the other side. netconvert takes the lanes on the
right of a road as those in its direction, also where traffic keeps left (ASAM OpenDRIVE 1.7, 10.3, attribute ``rule``:
there they are the lanes on the left).
"""

import math
from collections import defaultdict
from collections.abc import Collection, Iterator, Mapping, Sequence
from itertools import chain, pairwise
from typing import Final
from xml.etree.ElementTree import Element, ParseError, SubElement

from defusedxml import DefusedXmlException
from defusedxml.ElementTree import fromstring

from siren_ros.base.numerics.geometry import Polyline, wrap_angle
from siren_ros.errors import MapError
from siren_ros.simulation.roads.maps.netconvert import control_patches, document, normal_edges, points_of
from siren_ros.simulation.roads.net_parser import is_left_hand, paths_across, permissions_on
from siren_ros.simulation.roads.road_network import (
    OTHER_SIDE,
    Connection,
    RoadNetwork,
    negated,
    projected_from_geodetic,
)
from siren_ros.simulation.roads.routing import movement_turn_rad
from siren_ros.simulation.roads.sites import overlaps

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
    shoulders = {(edge.attrib["id"], index) for edge in normal_edges(net) for index in _open_shoulders(edge)}
    along = (Element("connection", ends) for _, ends in shoulder_movements(net, shoulders))
    return {
        "--node-files": document("nodes", nodes),
        "--edge-files": document("edges", _edge_patches(net, priorities, for_people=for_people)),
        "--connection-files": document("connections", along),
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


def shoulder_movements(
    net: Element, shoulders: Collection[tuple[str, int]], *, into_lanes: bool = False
) -> Iterator[tuple[Element, dict[str, str]]]:
    """Movements from shoulder to shoulder that a net lacks, given as edges and lane numbers.

    Each is parallel to a straight or right movement of the lane on its left. With ``into_lanes``, a right turn leads to
    the lane of that movement where no shoulder goes on.

    Yields:
        That movement, and the attributes of the missing one.
    """
    movements = {
        ((c.attrib["from"], int(c.attrib["fromLane"])), (c.attrib["to"], int(c.attrib["toLane"]))): c
        for c in net.iterfind("connection")
        if not c.attrib["from"].startswith(":")
    }
    for ((source, from_lane), (target, to_lane)), movement in movements.items():
        direction, beside = movement.get("dir"), (source, from_lane - 1)
        ahead = (target, to_lane - 1)
        if ahead not in shoulders and into_lanes and direction in {"r", "R"}:
            ahead = (target, to_lane)
        along = beside in shoulders and (ahead in shoulders or ahead[1] == to_lane)
        if direction in {"s", "r", "R"} and along and (beside, ahead) not in movements:
            lanes = {"fromLane": str(beside[1]), "toLane": str(ahead[1])}
            yield movement, {"from": source, "to": target, **lanes}


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


STOP: Final = "stop"
GIVE_WAY: Final = "give_way"
_NO_ROADS: Final = frozenset({"footway", "cycleway", "path", "steps", "pedestrian", "bridleway", "track", "corridor"})
_LONGEST_WALK: Final = 50
"""Greatest number of nodes from a sign to its junction."""
_HEADING_LIMIT_RAD: Final = 0.9
_BESIDE_M: Final = 15.0
"""Greatest distance of a sign from the edge that it binds: half of a wide road."""
_BEFORE_M: Final = 60.0
"""Greatest distance of a sign before the end of its edge."""
_BEYOND_M: Final = 25.0
"""Greatest distance of a sign beyond the end of its edge: netconvert cuts edges back where it joins junctions."""
_EARTH_RADIUS_M: Final = 6_371_000.0
_TAPER_RADIUS_M: Final = 12.0
"""Radius of the joints at which lanes fan out. It makes them about 22 m long, over which a car moves one lane aside at
30 km/h with 3 m/s². netconvert's own joints of 8 m allow 12 km/h."""
_TAPER_SWERVE_RAD: Final = 0.5
"""Sum of the turns to both sides from which a joint needs more length."""


def signed_edges(osm_xml: bytes, net: Element) -> tuple[frozenset[str], frozenset[str]]:
    """Ids of the edges that end at a stop sign, and at a give-way sign, of a net made of an OpenStreetMap extract."""
    roads = _RoadGraph(fromstring(osm_xml, forbid_dtd=True))
    edges = [(edge.attrib["id"], centre) for edge in normal_edges(net) if (centre := _centre(edge)) is not None]
    signed: dict[str, set[str]] = {STOP: set(), GIVE_WAY: set()}
    for node, tags in roads.signs:
        point = _point(net, *roads.places[node])
        for start, end in roads.stretches_bound_by(node, tags):
            edge = None if point is None else _edge_of(edges, point, roads.heading_rad(start, end))
            if edge is not None:
                signed[tags["highway"]].add(edge)
    return frozenset(signed[STOP]), frozenset(signed[GIVE_WAY] - signed[STOP])


def drives_on(edge: Element) -> bool:
    """Whether cars may use at least one lane of an edge."""
    return any(permissions_on(lane).civilian for lane in edge.iterfind("lane"))


def taper_patches(network: RoadNetwork) -> list[Element]:
    """``node`` elements that lengthen the joints between two pieces of a road at which lanes fan out too sharply.

    The lanes then fan out over a way on which nobody has to slow down.
    """
    return [
        Element("node", id=junction, radius=f"{_TAPER_RADIUS_M:g}")
        for junction, numbered in network.connections_at.items()
        if only_joins(network, movements := [movement for _, movement in numbered])
        and any(movement_turn_rad(network, movement) > _TAPER_SWERVE_RAD for movement in movements)
    ]


def crowded_joints(before: RoadNetwork, after: RoadNetwork) -> frozenset[str]:
    """Junctions at roads that lie over each other in the second of two nets of a map, and not in the first.

    There the longer joints reach into other junctions or roads.
    """
    known, joints = {tuple(before.lanes[lane].lane_id for lane in pair) for pair in overlaps(before)}, set()
    for pair in overlaps(after):
        lanes = [after.lanes[lane] for lane in pair]
        for lane in lanes if tuple(lane.lane_id for lane in lanes) not in known else ():
            edge = after.edges[lane.edge]
            joints |= {edge.from_junction, edge.to_junction}
            joints |= {way.junction for way in after.connections_over.get(lane.index, ())}
    return frozenset(joints)


def only_joins(network: RoadNetwork, movements: Sequence[Connection]) -> bool:
    """Whether all movements lead straight on, without control, each from one road piece to one other."""
    plain = all(c.direction == "s" and c.signal_id is None and not c.must_stop for c in movements)
    pairs = {(network.lanes[c.from_lane].edge, network.lanes[c.to_lane].edge) for c in movements}
    return plain and all(len({pair[side] for pair in pairs}) == len(pairs) for side in (0, 1))


def tags_of(element: Element) -> dict[str, str]:
    """The tags of a node, way or relation, by their keys."""
    return {tag.get("k", ""): tag.get("v", "") for tag in element.iterfind("tag")}


class _RoadGraph:
    """The roads of an extract as a graph of nodes."""

    def __init__(self, osm: Element) -> None:
        self.places = {
            node.attrib["id"]: (float(node.attrib["lat"]), float(node.attrib["lon"]))
            for node in osm.iterfind("node")
            if "lat" in node.attrib and "lon" in node.attrib
        }
        """Latitude and longitude of each node in degrees."""
        # Dictionaries with None as values serve as sets that keep their order.
        self._ahead: defaultdict[str, dict[str, None]] = defaultdict(dict)
        """Nodes to which traffic may drive from each node."""
        self._neighbours: defaultdict[str, dict[str, None]] = defaultdict(dict)
        self._along: defaultdict[str, dict[str, str]] = defaultdict(dict)
        """Each node's successors ``forward`` and ``backward`` along the way through it."""
        for way in osm.iterfind("way"):
            tags = tags_of(way)
            if tags.get("highway", "footway") not in _NO_ROADS:
                self._add(tags, [ref for node in way.iterfind("nd") if (ref := node.get("ref", "")) in self.places])
        nodes = ((node.attrib["id"], tags_of(node)) for node in osm.iterfind("node"))
        self.signs = [
            (node, tags) for node, tags in nodes if tags.get("highway") in {STOP, GIVE_WAY} and node in self._neighbours
        ]
        """Nodes with a sign, and their tags."""

    def _add(self, tags: Mapping[str, str], nodes: Sequence[str]) -> None:
        oneway = tags.get("oneway", "yes" if tags.get("junction") == "roundabout" else "no")
        for node, other in pairwise(nodes):
            self._neighbours[node][other] = self._neighbours[other][node] = None
            self._along[node]["forward"], self._along[other]["backward"] = other, node
            if oneway != "-1":
                self._ahead[node][other] = None
            if oneway not in {"yes", "true", "1"}:
                self._ahead[other][node] = None

    def stretches_bound_by(self, node: str, tags: Mapping[str, str]) -> Iterator[tuple[str, str]]:
        """The stretches of road, from node to node in driving direction, whose traffic a sign binds."""
        onward = self._ahead.get(node, {})
        if self._is_junction(node):
            if tags["highway"] == STOP and tags.get("stop", "all") == "all":
                yield from ((other, node) for other in self._neighbours[node] if node in self._ahead.get(other, ()))
        elif tags.get("direction") == "both":
            yield from ((node, other) for other in onward)
        elif (stated := self._along[node].get(tags.get("direction", ""))) in onward:
            yield node, stated
        elif onward:
            nearest = min(onward, key=lambda other: self._way_to_junction_m(node, other))
            if math.isfinite(self._way_to_junction_m(node, nearest)):
                yield node, nearest

    def _is_junction(self, node: str) -> bool:
        return len(self._neighbours.get(node, ())) > 2

    def _way_to_junction_m(self, sign: str, first: str) -> float:
        """Length of the road from a sign over a neighbouring node to the next junction; infinite without one."""
        before, at, length_m = sign, first, self._distance_m(sign, first)
        for _ in range(_LONGEST_WALK):
            if self._is_junction(at):
                return length_m
            onward = [node for node in self._neighbours.get(at, ()) if node != before]
            if not onward:
                break
            length_m += self._distance_m(at, onward[0])
            before, at = at, onward[0]
        return math.inf

    def heading_rad(self, start: str, end: str) -> float:
        """Direction from one node to another, counter-clockwise from east."""
        (lat, lon), (to_lat, to_lon) = self.places[start], self.places[end]
        return math.atan2(to_lat - lat, (to_lon - lon) * math.cos(math.radians(lat)))

    def _distance_m(self, start: str, end: str) -> float:
        (lat, lon), (to_lat, to_lon) = self.places[start], self.places[end]
        east = math.radians(to_lon - lon) * math.cos(math.radians(lat))
        return _EARTH_RADIUS_M * math.hypot(east, math.radians(to_lat - lat))


def _point(net: Element, lat_deg: float, lon_deg: float) -> tuple[float, float] | None:
    """A place in the net's coordinates; None where the projection is not known."""
    location = net.find("location")
    if location is None:
        return None
    projected = projected_from_geodetic(location.get("projParameter", "!"), lat_deg, lon_deg)
    east_m, north_m = (float(value) for value in location.get("netOffset", "0,0").split(","))
    return None if projected is None else (projected[0] + east_m, projected[1] + north_m)


def _centre(edge: Element) -> Polyline | None:
    """The middle lane of an edge; None where cars may not use it."""
    shapes = [lane.attrib["shape"] for lane in edge.iterfind("lane") if permissions_on(lane).civilian]
    try:
        return Polyline.through(points_of(shapes[len(shapes) // 2])[:, :2]) if shapes else None
    except ValueError:
        return None


def _edge_of(edges: Sequence[tuple[str, Polyline]], point: tuple[float, float], heading_rad: float) -> str | None:
    """The edge at whose end a sign for a direction of traffic stands: the nearest that runs that way."""
    near: list[tuple[float, str]] = []
    for edge_id, centre in edges:
        along, left = (float(value) for value in centre.project(point))
        rest_m = centre.length_m - along
        turned = abs(float(wrap_angle(centre.heading_rad(min(along, centre.length_m)) - heading_rad)))
        if turned <= _HEADING_LIMIT_RAD and abs(left) <= _BESIDE_M and -_BEYOND_M <= rest_m <= _BEFORE_M:
            near.append((abs(left) + 0.2 * abs(rest_m), edge_id))
    return min(near)[1] if near else None


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
