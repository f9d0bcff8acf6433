"""Reads a SUMO net (``.net.xml``) into a ``RoadNetwork``: lanes, who may use them, and the paths across junctions."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from hashlib import sha256
from itertools import compress
from operator import not_
from typing import Final, NamedTuple
from xml.etree.ElementTree import Element, ParseError

import numpy as np
from defusedxml import DefusedXmlException
from defusedxml.ElementTree import fromstring

from siren_ros.base.numerics.arrays import Points
from siren_ros.base.numerics.geometry import Polyline
from siren_ros.errors import MapError
from siren_ros.simulation.roads.road_network import (
    MAPS_KEPT,
    Connection,
    Edge,
    Junction,
    JunctionKind,
    Lane,
    LaneKind,
    RoadNetwork,
    geodetic_from_projected,
)

LONGEST_VIA: Final = 100
"""Most junction lanes of one movement; netconvert makes two or three."""


class PathAcross(NamedTuple):
    """One movement across a junction, by the ids of its lanes."""

    source: str
    target: str
    via: tuple[str, ...]
    """Junction lanes in driving order. Long paths have two, with a place to wait between them; a movement without a
    path has none."""


def way_across(first: str | None, onward: Callable[[str], str | None]) -> tuple[str, ...]:
    """The junction lanes of a movement in driving order, from its first one (None where it has none).

    ``onward`` gives the junction lane that follows on another; None after the last.

    Raises:
        ValueError: They lead on for ever, as those of a damaged net do.
    """
    via: list[str] = []
    lane = first
    while lane is not None:
        via.append(lane)
        if len(via) > LONGEST_VIA:
            raise ValueError(f"a way through junction lanes from {first} that does not end")
        lane = onward(lane)
    return tuple(via)


def paths_across(net: Element) -> Iterator[PathAcross]:
    """All movements of a net, in its order. The second part of a path is the ``via`` of what leaves its first.

    Raises:
        ValueError: A path does not end.
    """
    connections = [
        (f"{c.get('from')}_{c.get('fromLane')}", f"{c.get('to')}_{c.get('toLane')}", c.get("via"))
        for c in net.iterfind("connection")
    ]
    onward = {source: via for source, _, via in connections}
    for source, target, via in connections:
        if not source.startswith(":"):
            yield PathAcross(source, target, way_across(via, onward.get))


_CIVILIAN_CLASSES: Final = frozenset({"passenger", "bus", "taxi", "delivery", "truck", "private", "coach", "trailer"})
"""Vehicle classes whose lane is a driving lane, even where passenger cars may not use it (a bus lane)."""
_FOOT_TYPES: Final = frozenset({"sidewalk", "walking"})


@dataclass(frozen=True)
class Permissions:
    """Which classes of vehicles may use a lane."""

    civilian: bool
    """Whether passenger cars may use the lane."""
    emergency: bool
    pedestrian: bool
    bicycle: bool = False
    other_motor: bool = False
    """Whether some class of motor traffic may use the lane, whether or not passenger cars may."""

    @property
    def any_motor(self) -> bool:
        """Whether some motor vehicle may use the lane."""
        return self.civilian or self.emergency or self.other_motor


def permissions_of(allow: str | None, disallow: str | None) -> Permissions:
    """Permissions of a lane by its attributes; a lane with neither is open to every class.

    ``allow`` wins where both are given, as in SUMO.
    """
    if allow is not None:
        allowed = frozenset(allow.split())
        open_to = (lambda _: True) if "all" in allowed else allowed.__contains__
    else:
        refused = frozenset((disallow or "").split())
        open_to = (lambda _: False) if "all" in refused else (lambda name: name not in refused)
    return Permissions(
        civilian=bool(open_to("passenger")),
        emergency=bool(open_to("emergency")),
        pedestrian=bool(open_to("pedestrian")),
        bicycle=bool(open_to("bicycle")),
        other_motor=any(open_to(name) for name in sorted(_CIVILIAN_CLASSES)),
    )


def permissions_on(lane: Element) -> Permissions:
    """Which classes may use a ``lane`` element of a net."""
    return permissions_of(lane.get("allow"), lane.get("disallow"))


def kind_of_lane(permissions: Permissions, lane_type: str) -> LaneKind:
    """Kind of a lane outside junctions, from who may use it and from the type that the map gave it."""
    if lane_type in _FOOT_TYPES:
        return LaneKind.SIDEWALK
    if permissions.civilian or permissions.other_motor:
        return LaneKind.DRIVING
    if permissions.emergency:
        return LaneKind.SHOULDER
    if permissions.pedestrian:
        return LaneKind.SIDEWALK
    return LaneKind.CYCLE if permissions.bicycle else LaneKind.KERB


PROLONGED: Final = "prolonged_m"
"""Name of the parameter of a net's edge that says by how many metres SIREN prolonged it."""
ALLOWED: Final = "a SUMO net as netconvert writes it (.net.xml)"
DEFAULT_LANE_WIDTH_M: Final = 3.2
"""SUMO's width of a lane that states none (SUMO user documentation, "Road networks")."""
FAR_OFFSET_M: Final = 10_000.0
"""An origin farther than this from the middle of a map, as that of UTM, is replaced by the middle: meshes and sweeps
have single precision, which is 1 mm at this distance and half a metre at a northing of UTM."""
_KEPT_DECIMALS: Final = 6
"""Nets have two to four decimals; double precision has eight at 10,000 km."""
FARTHEST_M: Final = 1e8
"""Largest coordinate that is accepted; no projection of the Earth has larger ones."""
MAX_MAP_BYTES: Final = 200_000_000
MAX_TAGS: Final = 3_000_000
"""Most XML elements of a net, at some 200 bytes of memory each. The net of a city of 100,000 lanes has half a
million."""
MOST_POINTS: Final = 50_000
"""Most points of one shape: a lane of 100 km with a point every 2 m, as netconvert draws bends."""
SHORTEST_LANE_M: Final = 0.01
"""Length given to the internal lanes that netconvert rounds down to a point."""

_JUNCTION_KINDS: Final[Mapping[str, JunctionKind]] = {
    "traffic_light": JunctionKind.SIGNAL,
    "traffic_light_unregulated": JunctionKind.SIGNAL,
    "traffic_light_right_on_red": JunctionKind.SIGNAL,
    "allway_stop": JunctionKind.ALL_WAY_STOP,
    "priority_stop": JunctionKind.PRIORITY_STOP,
    "priority": JunctionKind.PRIORITY,
    "zipper": JunctionKind.PRIORITY,
    "dead_end": JunctionKind.DEAD_END,
}
_STOP_STATES: Final = frozenset({"s", "w"})
"""SUMO's link states of a stop sign: at a junction with priority and at an all-way stop."""
_GIVE_WAY_STATES: Final = frozenset({"m", "=", "w", "s"})
"""SUMO's link states of a movement without a signal that is not on the major road."""
_PATH_FUNCTIONS: Final = frozenset({"internal", "crossing"})
_LEFT_OUT_FUNCTIONS: Final = frozenset({"walkingarea"})


@lru_cache(maxsize=MAPS_KEPT)
def parse_road_network(net_xml: bytes) -> RoadNetwork:
    """The road network of a SUMO net, in the ``map`` frame (``map = sumo − offset``).

    The last maps are kept: the nodes of one process, and episodes on one map, share them.

    The offset is the net's ``netOffset``, so that a map from OpenDRIVE keeps its own coordinates. A net in
    UTM coordinates would put the origin thousands of kilometres away; its origin is the middle of the map
    instead (``FAR_OFFSET_M``). Lanes, edges and connections keep the order of the file. Walking areas are left out,
    and so are movements that neither civilians nor emergency vehicles nor cyclists on cycle lanes make.

    Raises:
        MapError: The bytes are not a SUMO net, or it has no lane that vehicles may drive on.
    """
    if len(net_xml) > MAX_MAP_BYTES or net_xml.count(b"<") > MAX_TAGS:
        raise MapError(f"a net of {len(net_xml)} bytes", f"at most {MAX_MAP_BYTES} bytes and {MAX_TAGS} XML tags")
    try:
        root = fromstring(net_xml, forbid_dtd=True)
    except (ParseError, DefusedXmlException, ValueError, LookupError) as error:
        raise MapError(f"unreadable XML ({error})", ALLOWED) from error
    if root.tag != "net":
        raise MapError(f"an XML document <{root.tag}>", ALLOWED)
    try:
        network = _network(root)
    except (LookupError, ValueError, AttributeError, OverflowError) as error:
        raise MapError(f"a damaged net ({type(error).__name__}: {error})", ALLOWED) from error
    if not any(lane.kind is LaneKind.DRIVING for lane in network.lanes):
        raise MapError("a net without driving lanes", "a map with at least one lane that cars may use")
    object.__setattr__(network, "net_sha256", sha256(net_xml).hexdigest())
    return network


def _network(root: Element) -> RoadNetwork:
    offset_m, projection, origin_lat_lon_deg, projected_m = _location(root)
    lanes, edges = _lanes_and_edges(root, offset_m)
    connections = tuple(_connections(root, lanes, edges))
    of_cyclists = [_on_cycle_lane(lanes, connection) for connection in connections]
    return RoadNetwork(
        lanes=lanes,
        edges=edges,
        connections=tuple(compress(connections, map(not_, of_cyclists))),
        junctions=_junctions(root, offset_m),
        sumo_offset_m=offset_m,
        projection=projection,
        origin_lat_lon_deg=origin_lat_lon_deg,
        projected_origin_m=projected_m,
        crossings=tuple(_crossings(root, offset_m)),
        left_hand=is_left_hand(root),
        cycle_connections=tuple(compress(connections, of_cyclists)),
    )


def is_left_hand(net: Element) -> bool:
    """Whether traffic keeps left on a net."""
    return net.get("lefthand", "").lower() in {"true", "1", "yes"}


def _on_cycle_lane(lanes: Sequence[Lane], connection: Connection) -> bool:
    return LaneKind.CYCLE in {lanes[connection.from_lane].kind, lanes[connection.to_lane].kind}


_Pair = tuple[float, float]


def _location(root: Element) -> tuple[_Pair, str, _Pair | None, _Pair]:
    """Offset of the map frame, projection, latitude and longitude of the origin and its place in the projection."""
    element = root.find("location")
    stated: Mapping[str, str] = {} if element is None else element.attrib
    net_x, net_y = (float(value) for value in stated.get("netOffset", "0,0").split(","))
    projection = stated.get("projParameter", "!").strip()
    if not max(abs(net_x), abs(net_y)) <= FARTHEST_M:
        raise ValueError("an offset that is not on Earth")
    offset, middle = (net_x, net_y), _middle(root)
    if _is_far(offset, middle):
        west, south, east, north = (float(value) for value in stated.get("convBoundary", "0,0,0,0").split(","))
        boundary = (west + east) / 2.0, (south + north) / 2.0
        x, y = middle if _is_far(boundary, middle) else boundary
        offset = (round(x), round(y))
    projected = (offset[0] - net_x, offset[1] - net_y)
    return offset, projection, geodetic_from_projected(projection, *projected), projected


def _middle(root: Element) -> _Pair:
    """The middle of a net's junctions, in the net's coordinates."""
    x, y = ([float(junction.attrib[axis]) for junction in root.iterfind("junction")] or [0.0] for axis in "xy")
    if not max(map(abs, (*x, *y))) <= FARTHEST_M:
        raise ValueError("a junction that is not on Earth")
    return (min(x) + max(x)) / 2.0, (min(y) + max(y)) / 2.0


def _is_far(place: _Pair, other: _Pair) -> bool:
    return max(abs(place[0] - other[0]), abs(place[1] - other[1])) > FAR_OFFSET_M


def check_shape(shape: str) -> None:
    """Accepts a ``shape`` attribute of at most ``MOST_POINTS`` points; raises ValueError otherwise."""
    if shape.count(" ") >= MOST_POINTS or shape.count(",") > 2 * MOST_POINTS:
        raise ValueError(f"a shape of more than {MOST_POINTS} points")


def _points(shape: str, offset_m: tuple[float, float]) -> Points:
    check_shape(shape)
    values = [[float(number) for number in point.split(",")[:2]] for point in shape.split()]
    points = np.array(values, dtype=np.float64).reshape(-1, 2)
    if not (np.abs(points) <= FARTHEST_M).all():
        raise ValueError("a point that is not on Earth")
    return _moved(points, offset_m)


def _moved(points: Points, offset_m: _Pair) -> Points:
    """Points ``(..., 2)`` in the ``map`` frame; far from the net's origin without the rounding of large numbers."""
    moved = points - offset_m
    return moved if max(map(abs, offset_m)) <= FAR_OFFSET_M else moved.round(_KEPT_DECIMALS)


def _centre(points: Points) -> Polyline:
    if len(points) == 0:
        raise ValueError("a lane without a shape")
    if np.linalg.norm(np.diff(points, axis=0), axis=1).sum() < SHORTEST_LANE_M / 2.0:
        points = np.stack((points[0], points[0] + (SHORTEST_LANE_M, 0.0)))
    return Polyline.through(points)


def _lanes_and_edges(root: Element, offset_m: tuple[float, float]) -> tuple[tuple[Lane, ...], tuple[Edge, ...]]:
    lanes: list[Lane] = []
    edges: list[Edge] = []
    for element in root.iterfind("edge"):
        function = element.get("function", "normal")
        if function in _LEFT_OUT_FUNCTIONS:
            continue
        first, edge_id = len(lanes), element.attrib["id"]
        for lane in element.iterfind("lane"):
            lanes.append(_lane(lane, len(lanes), len(edges), function, offset_m))
        junction = edge_id[1:].rpartition("_")[0]
        edges.append(
            Edge(
                index=len(edges),
                edge_id=edge_id,
                lanes=tuple(range(first, len(lanes))),
                from_junction=element.get("from", junction),
                to_junction=element.get("to", junction),
                internal=function in _PATH_FUNCTIONS,
                name=element.get("name", ""),
                prolonged_m=prolonged_m(element),
            )
        )
    return tuple(lanes), tuple(edges)


def prolonged_m(edge: Element) -> float:
    """Length by which an edge of a net was prolonged (``Edge.prolonged_m``)."""
    found = edge.find(f"param[@key='{PROLONGED}']")
    return 0.0 if found is None else float(found.get("value", "0"))


def _lane(element: Element, index: int, edge: int, function: str, offset_m: tuple[float, float]) -> Lane:
    width_m = float(element.get("width", DEFAULT_LANE_WIDTH_M))
    permissions = permissions_on(element)
    if function == "internal":
        kind = LaneKind.INTERNAL
    elif function == "crossing":
        kind, permissions = LaneKind.CROSSING, Permissions(civilian=False, emergency=False, pedestrian=True)
    else:
        kind = kind_of_lane(permissions, element.get("type", ""))
    return Lane(
        index=index,
        lane_id=element.attrib["id"],
        edge=edge,
        position=int(element.attrib["index"]),
        kind=kind,
        centre=_centre(_points(element.attrib["shape"], offset_m)),
        width_m=width_m,
        speed_limit_mps=float(element.attrib["speed"]),
        emergency_allowed=permissions.emergency,
        civilian_allowed=permissions.civilian,
    )


def _links(root: Element) -> tuple[dict[tuple[str, int], str], dict[tuple[str, int], float]]:
    """Letters of each link of a signal in the phases of all its programmes, in small ones, and its longest yellow."""
    letters: dict[tuple[str, int], str] = {}
    yellow_s: dict[tuple[str, int], float] = {}
    for logic in root.iterfind("tlLogic"):
        for phase in logic.iterfind("phase"):
            for link, letter in enumerate(phase.get("state", "").lower()):
                key = logic.get("id", ""), link
                letters[key] = letters.get(key, "") + letter
                if letter == "y":
                    yellow_s[key] = max(yellow_s.get(key, 0.0), float(phase.get("duration", "0")))
    return letters, yellow_s


def _connections(root: Element, lanes: tuple[Lane, ...], edges: tuple[Edge, ...]) -> Iterator[Connection]:
    lane_of = {(edges[lane.edge].edge_id, lane.position): lane.index for lane in lanes}
    index_of = {lane.lane_id: lane.index for lane in lanes}
    elements, (letters, yellow_s) = root.findall("connection"), _links(root)
    onward = {
        (element.attrib["from"], int(element.attrib["fromLane"]), element.attrib["to"]): element.get("via")
        for element in elements
        if element.attrib["from"].startswith(":")
    }
    for element in elements:
        from_lane = lane_of.get((element.attrib["from"], int(element.attrib["fromLane"])))
        to_lane = lane_of.get((element.attrib["to"], int(element.attrib["toLane"])))
        if from_lane is None or to_lane is None:
            continue
        source, target = lanes[from_lane], lanes[to_lane]
        civilian = source.civilian_allowed and target.civilian_allowed
        usable = civilian or (source.emergency_allowed and target.emergency_allowed)
        usable |= LaneKind.CYCLE in {source.kind, target.kind}
        if edges[source.edge].internal or edges[target.edge].internal or not usable:
            continue

        def next_part(step: str, to: str = element.attrib["to"]) -> str | None:
            internal = lanes[index_of[step]]
            return onward.get((edges[internal.edge].edge_id, internal.position, to))

        via = way_across(element.get("via"), next_part)
        signal, link = element.get("tl"), int(element.get("linkIndex", "-1"))
        shown = letters.get((signal or "", link), "")
        yield Connection(
            from_lane=from_lane,
            to_lane=to_lane,
            via=tuple(index_of[step] for step in via),
            direction=element.get("dir", "s").replace("T", "t"),  # SUMO writes T in nets with left-hand traffic
            signal_id=signal,
            signal_link=link,
            must_stop=element.get("state") in _STOP_STATES and signal is None,
            junction=edges[source.edge].to_junction,
            gives_way=element.get("state") in _GIVE_WAY_STATES and signal is None,
            alternates=not shown or {"r", "g"} <= set(shown),
            green_phases=frozenset(number for number, letter in enumerate(shown) if letter == "g"),
            yellow_s=yellow_s.get((signal or "", link), 0.0),
        )


def _junctions(root: Element, offset_m: tuple[float, float]) -> dict[str, Junction]:
    junctions: dict[str, Junction] = {}
    for element in root.iterfind("junction"):
        name, kind = element.attrib["id"], element.get("type", "")
        if kind != "internal":
            place = _moved(np.array([float(element.attrib["x"]), float(element.attrib["y"])]), offset_m)
            outline = _points(element.get("shape", ""), offset_m)
            x_m, y_m = place.tolist()
            junctions[name] = Junction(name, _JUNCTION_KINDS.get(kind, JunctionKind.UNCONTROLLED), outline, x_m, y_m)
    return junctions


def _crossings(root: Element, offset_m: tuple[float, float]) -> Iterator[Points]:
    for element in root.iterfind("edge[@function='crossing']"):
        for lane in element.iterfind("lane"):
            if (outline := lane.get("outlineShape")) is not None:
                yield _points(outline, offset_m)
                continue
            centre = _centre(_points(lane.attrib["shape"], offset_m))
            half_m = float(lane.get("width", DEFAULT_LANE_WIDTH_M)) / 2.0
            left, right = (centre.offset_points(centre.arc_m, side_m) for side_m in (half_m, -half_m))
            yield np.concatenate((left, right[::-1]))
