"""Mends the lanes of a compiled net: corners become bends that a car can follow, lengths are those of the shapes.

Paths across junctions leave and enter lanes without a corner. Where a road changes its number of lanes, they fan
out over a way on which nobody has to slow down.
"""

from typing import Final
from xml.etree.ElementTree import Element, register_namespace, tostring

import numpy as np
import numpy.typing as npt
from defusedxml.ElementTree import fromstring

from siren_ros.roads.movements import movement_turn_rad
from siren_ros.roads.net_parser import FARTHEST_M, MAX_MAP_BYTES, check_shape, paths_across, permissions_of
from siren_ros.roads.road_network import Connection, RoadNetwork

_CORNER_RAD: Final = 0.17
"""Change of direction from which the end of a path is a corner (10°)."""
_SHORTEST_PATH_M: Final = 2.0
"""Shorter paths stay as they are."""
_HANDLE: Final = 0.39
"""Length of a Bézier curve's handles over its chord: a quarter turn becomes nearly a circle."""
_POINTS: Final = 17

Points = npt.NDArray[np.float64]


def mend_junction_paths(net: Element) -> None:
    """Gives the paths with corners at their ends the shape of a Bézier curve, in place; heights stay linear."""
    lanes = {lane.attrib["id"]: lane for lane in net.iter("lane") if lane.get("shape")}
    for movement in paths_across(net):
        source, target = lanes.get(movement.source), lanes.get(movement.target)
        path = [lanes[lane] for lane in movement.via if lane in lanes]
        if path and source is not None and target is not None:
            _mend(source, path, target)


def _mend(source: Element, path: list[Element], target: Element) -> None:
    shapes = [points_of(lane.attrib["shape"]) for lane in path]
    flat = min(shape.shape[1] for shape in shapes)
    shapes = [shape[:, :flat] for shape in shapes]
    enters, leaves = _direction(points_of(source.attrib["shape"])[-2:]), _direction(points_of(target.attrib["shape"]))
    start, end = shapes[0][0], shapes[-1][-1]
    corners = _angle_rad(enters, _direction(shapes[0])), _angle_rad(_direction(shapes[-1][-2:]), leaves)
    chord_m = float(np.hypot(*(end - start)[:2]))
    if chord_m < _SHORTEST_PATH_M or max(corners) < _CORNER_RAD:
        return
    share = np.linspace(0.0, 1.0, _POINTS)[:, None]
    handle_m = _HANDLE * chord_m
    handles = (start[:2], start[:2] + handle_m * enters, end[:2] - handle_m * leaves, end[:2])
    weights = ((1.0 - share) ** 3, 3.0 * share * (1.0 - share) ** 2, 3.0 * share**2 * (1.0 - share), share**3)
    level = sum((weight * point for weight, point in zip(weights, handles, strict=True)), np.zeros((_POINTS, 2)))
    curve = np.concatenate((level, (start + share * (end - start))[:, 2:]), axis=1)
    lengths = [float(np.linalg.norm(np.diff(shape[:, :2], axis=0), axis=1).sum()) for shape in shapes]
    cuts = np.round(np.cumsum(lengths) / sum(lengths) * (_POINTS - 1)).astype(int)
    first = 0
    for lane, last in zip(path, cuts.tolist(), strict=True):
        begin = min(first, _POINTS - 2)
        first = max(last, begin + 1)
        lane.set("shape", text_of(curve[begin : first + 1]))


def _direction(points: Points) -> Points:
    """Unit vector from the first point of a line to the second."""
    side = points[1, :2] - points[0, :2]
    return np.asarray(side / max(float(np.hypot(*side)), 1e-9))


def _angle_rad(first: Points, second: Points) -> float:
    return float(abs(np.arctan2(first[0] * second[1] - first[1] * second[0], first @ second)))


def points_of(shape: str) -> Points:
    """The points of a ``shape`` attribute, shape ``(K, 2)`` or ``(K, 3)``; ValueError where it is none."""
    check_shape(shape)
    points = [[float(number) for number in point.split(",")] for point in shape.split()]
    flat = min(len(point) for point in points)
    found = np.array([point[:flat] for point in points], dtype=np.float64)
    if not (np.abs(found) <= FARTHEST_M).all():
        raise ValueError("a point that is not on Earth")
    return found


def text_of(points: Points) -> str:
    """A ``shape`` attribute."""
    return " ".join(",".join(f"{value:.4f}".rstrip("0").rstrip(".") for value in point) for point in points)


_SHARPEST_KEPT_RAD: Final = 0.02
"""A corner that turns less than this stays."""
_TURN_PER_POINT_RAD: Final = 0.05
"""A rounded corner gets a point for each such part of its turn (3°)."""
_FARTHEST_CUT_M: Final = 6.0
"""A rounded corner begins at most this far before the vertex."""
_LARGEST_SHIFT_M: Final = 0.3
"""A rounded corner passes its vertex at most at this distance: a tenth of a lane's width."""
_ONE_LENGTH_SHARE: Final = 0.05
"""Lanes of one edge keep one length, their mean, while none differs from it by more than this share. SUMO expects equal
lengths when vehicles change lanes; a lane that differs more has its own."""
_LEAST_SIDE_M: Final = 0.05
_SHORTEST_M: Final = 0.1
"""netconvert's own least length of a lane."""
_MENDED_FUNCTIONS: Final = frozenset({"normal", "internal"})
_SCHEMA: Final = "http://www.w3.org/2001/XMLSchema-instance"


def mended_lanes(net_xml: bytes) -> bytes:
    """The net with rounded lane shapes and lengths that fit them.

    Edges for pedestrians at junctions and everything but ``shape`` and ``length`` of lanes stay as they are.

    Args:
        net_xml: A SUMO net as netconvert writes it; anything else is given back unchanged.

    Raises:
        ValueError, LookupError: The net is damaged.
    """
    root = fromstring(net_xml, forbid_dtd=True)
    if root.tag != "net":
        return net_xml
    mend_junction_paths(root)
    written = 0
    for edge in root.iterfind("edge"):
        if edge.get("function", "normal") in _MENDED_FUNCTIONS:
            _mend_edge(edge)
        written += sum(len(lane.get("shape", "")) for lane in edge.iterfind("lane"))
        if written > MAX_MAP_BYTES:
            raise ValueError(f"a net of more than {MAX_MAP_BYTES // 1_000_000} MB once its corners are rounded")
    register_namespace("xsi", _SCHEMA)
    document: bytes = tostring(root, encoding="utf-8", xml_declaration=True)
    return document


def _mend_edge(edge: Element) -> None:
    lanes = [lane for lane in edge.iterfind("lane") if lane.get("shape")]
    for lane in lanes:
        points = points_of(lane.attrib["shape"])
        if len(points) > 2:
            lane.set("shape", text_of(rounded(points)))
    open_lanes = [lane for lane in lanes if _is_driven_on(lane)] or lanes
    lengths = [_length_m(lane) for lane in open_lanes]
    if not lengths:
        return
    mean_m = sum(lengths) / len(lengths)
    for lane in lanes:
        own_m = _length_m(lane)
        alike = edge.get("function", "normal") == "normal" and abs(own_m - mean_m) <= _ONE_LENGTH_SHARE * mean_m
        together = alike or lane not in open_lanes
        lane.set("length", f"{max(mean_m if together else own_m, _SHORTEST_M):.3f}")


def rounded(points: Points) -> Points:
    """A polyline, shape ``(K, 2)`` or ``(K, 3)``, with its corners replaced by parabolas; the ends stay.

    The parabola of a corner begins halfway to the next vertex, or nearer (``_FARTHEST_CUT_M``, ``_LARGEST_SHIFT_M``),
    and is tangent to both sides. A regular polygon becomes nearly a circle.
    """
    apart = np.linalg.norm(np.diff(points[:, :2], axis=0), axis=1)
    kept = points[np.concatenate(([True], apart > 1e-3))]
    if len(kept) < 3:
        return points
    side = np.diff(kept, axis=0)
    side_m = np.linalg.norm(side[:, :2], axis=1)
    unit = side / side_m[:, None]
    found = [kept[:1]]
    for vertex in range(1, len(kept) - 1):
        before, after = unit[vertex - 1], unit[vertex]
        turn = abs(np.arctan2(before[0] * after[1] - before[1] * after[0], before[:2] @ after[:2]))
        if turn < _SHARPEST_KEPT_RAD:
            found.append(kept[vertex : vertex + 1])
            continue
        cut = min(0.5 * side_m[vertex - 1], 0.5 * side_m[vertex], _FARTHEST_CUT_M)
        cut = min(cut, 2.0 * _LARGEST_SHIFT_M / np.sin(0.5 * turn))
        share = np.linspace(0.0, 1.0, int(np.ceil(turn / _TURN_PER_POINT_RAD)) + 2)[:, None]
        first, last = kept[vertex] - cut * before, kept[vertex] + cut * after
        found.append((1.0 - share) ** 2 * first + 2.0 * share * (1.0 - share) * kept[vertex] + share**2 * last)
    return _without_near_points(np.concatenate([*found, kept[-1:]]))


def _without_near_points(points: Points) -> Points:
    """The points but those that follow another one too closely to show a direction; the ends stay."""
    found = [points[0]]
    for point in points[1:-1]:
        if min(np.hypot(*(point - other)[:2]) for other in (found[-1], points[-1])) >= _LEAST_SIDE_M:
            found.append(point)
    return np.stack([*found, points[-1]])


def _is_driven_on(lane: Element) -> bool:
    permissions = permissions_of(lane.get("allow"), lane.get("disallow"))
    return permissions.civilian or permissions.emergency or permissions.other_motor


def _length_m(lane: Element) -> float:
    sides = np.diff(points_of(lane.attrib["shape"])[:, :2], axis=0)
    return float(np.linalg.norm(sides, axis=1).sum())


_RADIUS_M: Final = 12.0
"""Makes a junction of about 22 m, over which a car goes one lane aside at 30 km/h with 3 m/s². netconvert's own joints
of 8 m allow 12 km/h."""
_SWERVE_RAD: Final = 0.5
"""Sum of the turns to both sides from which a joint needs more length."""


def taper_patches(network: RoadNetwork) -> list[Element]:
    """``node`` elements that lengthen the joints between two pieces of a road at which lanes fan out too sharply.

    Args:
        network: A net of netconvert, as ``parse_road_network`` gives it.
    """
    return [
        Element("node", id=junction, radius=f"{_RADIUS_M:g}")
        for junction, movements in network.connections_at.items()
        if _only_joins(network, [one for _, one in movements])
        and any(movement_turn_rad(network, one) > _SWERVE_RAD for _, one in movements)
    ]


def _only_joins(network: RoadNetwork, movements: list[Connection]) -> bool:
    """Whether all movements lead straight on, without control, each from one road piece to one other."""
    plain = all(one.direction == "s" and one.signal_id is None and not one.must_stop for one in movements)
    pairs = {(network.lanes[one.from_lane].edge, network.lanes[one.to_lane].edge) for one in movements}
    return plain and all(len({pair[side] for pair in pairs}) == len(pairs) for side in (0, 1))
