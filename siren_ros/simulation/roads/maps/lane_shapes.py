"""Corrects the lanes of a compiled net: cars can follow their bends, and lengths are those of the shapes.

netconvert draws bends as polygons with sides of 2 to 10 m, some turning movements of OpenDRIVE maps as straight lines
from lane to lane, and gives all lanes of an edge one length. SUMO's vehicles would turn in jerks at every corner, and
change their speed where a lane is longer or shorter than its stated length.
"""

from typing import Final
from xml.etree.ElementTree import Element, register_namespace

import numpy as np
from defusedxml.ElementTree import fromstring

from siren_ros.base.numerics.arrays import Points
from siren_ros.simulation.roads.maps.netconvert import document
from siren_ros.simulation.roads.net_parser import FARTHEST_M, MAX_MAP_BYTES, check_shape, paths_across, permissions_on

_SHARPEST_KEPT_RAD: Final = 0.02
"""A corner with a smaller change of direction stays as it is."""
_TURN_PER_POINT_RAD: Final = 0.05
"""A rounded corner gets one point for each such change of direction (3°)."""
_FARTHEST_CUT_M: Final = 6.0
"""A rounded corner begins at most this far before the vertex."""
_LARGEST_SHIFT_M: Final = 0.3
"""A rounded corner passes its vertex at most at this distance: a tenth of a lane's width."""
_ONE_LENGTH_SHARE: Final = 0.1
"""Lanes of one edge keep one length, their mean, while none differs from it by more than this share: where vehicles
change lanes, SUMO takes places with equal lengths for places side by side. A lane that differs more has its own: on it
a bus of 12 m would become shorter, for SUMO, by most of the 2 m that it keeps behind it."""
_STEP_BACK_M: Final = 1.0
"""Only shorter sides are removed where a line goes back; longer ones lead somewhere."""
_LEAST_SIDE_M: Final = 0.05
_SHORTEST_M: Final = 0.1
"""netconvert's own least length of a lane."""
_CORNER_RAD: Final = 0.17
"""Change of direction from which the end of a path across a junction is a corner (10°)."""
_SHORTEST_PATH_M: Final = 2.0
"""Shorter paths across junctions stay as they are, unless they lead backwards."""
_HANDLE: Final = 0.39
"""Length of a Bézier curve's handles over its chord: a quarter turn becomes nearly a circle."""
_POINTS: Final = 17


def mended_lanes(net_xml: bytes) -> bytes:
    """The net with rounded lane shapes and lengths that fit them.

    Edges for pedestrians at junctions and everything but ``shape`` and ``length`` of lanes stay as they are. What is no
    SUMO net is given back unchanged.

    Raises:
        ValueError, LookupError: The net is damaged.
    """
    root = fromstring(net_xml, forbid_dtd=True)
    if root.tag != "net":
        return net_xml
    mend_junction_paths(root)
    written = 0
    for edge in root.iterfind("edge"):
        if edge.get("function", "normal") in {"normal", "internal"}:
            _mend_edge(edge)
        written += sum(len(lane.get("shape", "")) for lane in edge.iterfind("lane"))
        if written > MAX_MAP_BYTES:
            raise ValueError(f"a net of more than {MAX_MAP_BYTES // 1_000_000} MB once its corners are rounded")
    register_namespace("xsi", "http://www.w3.org/2001/XMLSchema-instance")
    return document(root)


def _mend_edge(edge: Element) -> None:
    lengths_m: dict[Element, float] = {}
    for lane in edge.iterfind("lane"):
        if lane.get("shape"):
            points = points_of(lane.attrib["shape"])
            if not permissions_on(lane).any_motor:
                points = without_steps_back(points)
            if len(points) > 2:
                lane.set("shape", text_of(rounded(points)))
            lengths_m[lane] = _length_m(points_of(lane.attrib["shape"]))
    driven = {lane for lane in lengths_m if permissions_on(lane).any_motor} or set(lengths_m)
    mean_m = sum(length_m for lane, length_m in lengths_m.items() if lane in driven) / max(len(driven), 1)
    is_normal = edge.get("function", "normal") == "normal"
    for lane, length_m in lengths_m.items():
        alike = is_normal and abs(length_m - mean_m) <= _ONE_LENGTH_SHARE * mean_m
        lane.set("length", f"{max(mean_m if alike or lane not in driven else length_m, _SHORTEST_M):.3f}")


def without_steps_back(points: Points) -> Points:
    """A polyline, shape ``(K, 2)`` or more, without short sides on which it goes back; its ends stay.

    netconvert leaves some where the inner side of a bend is drawn: on them SUMO's people turn round twice, and jump to
    the other side of the sidewalk.
    """
    side = np.diff(points[:, :2], axis=0)
    short = np.linalg.norm(side, axis=1) < _STEP_BACK_M
    back = ((side[1:] * side[:-1]).sum(axis=1) < 0.0) & (short[1:] | short[:-1])
    if not back.any():
        return points
    return without_steps_back(np.delete(points, int(np.argmax(back)) + 1, axis=0))


def rounded(points: Points) -> Points:
    """A polyline, shape ``(K, 2)`` or ``(K, 3)``, with its corners replaced by parabolas; the ends stay.

    The parabola of a corner begins halfway to the next vertex, or nearer (``_FARTHEST_CUT_M``, ``_LARGEST_SHIFT_M``),
    and is tangent to both sides. A regular polygon becomes nearly a circle. Points that follow another one too closely
    to show a direction are left out.
    """
    apart = np.linalg.norm(np.diff(points[:, :2], axis=0), axis=1)
    kept = points[np.concatenate(([True], apart > 1e-3))]
    if len(kept) < 3:
        return points
    side = np.diff(kept, axis=0)
    side_m = np.linalg.norm(side[:, :2], axis=1)
    unit = side / side_m[:, None]
    pieces = [kept[:1]]
    for number, vertex in enumerate(kept[1:-1]):
        before, after = unit[number], unit[number + 1]
        turn = _turn_rad(before, after)
        if turn < _SHARPEST_KEPT_RAD:
            pieces.append(vertex[None])
            continue
        cut = min(0.5 * side_m[number], 0.5 * side_m[number + 1], _FARTHEST_CUT_M)
        cut = min(cut, 2.0 * _LARGEST_SHIFT_M / np.sin(0.5 * turn))
        share = np.linspace(0.0, 1.0, int(np.ceil(turn / _TURN_PER_POINT_RAD)) + 2)[:, None]
        first, last = vertex - cut * before, vertex + cut * after
        pieces.append((1.0 - share) ** 2 * first + 2.0 * share * (1.0 - share) * vertex + share**2 * last)
    curve = np.concatenate([*pieces, kept[-1:]])
    distinct = [curve[0]]
    for point in curve[1:-1]:
        if min(np.hypot(*(point - other)[:2]) for other in (distinct[-1], curve[-1])) >= _LEAST_SIDE_M:
            distinct.append(point)
    return np.stack([*distinct, curve[-1]])


def mend_junction_paths(net: Element) -> None:
    """Gives the paths with corners at their ends the shape of a Bézier curve, in place; heights stay linear."""
    lanes = {lane.attrib["id"]: lane for lane in net.iter("lane") if lane.get("shape")}
    for movement in paths_across(net):
        source, target = lanes.get(movement.source), lanes.get(movement.target)
        path = [lanes[lane] for lane in movement.via if lane in lanes]
        if path and source is not None and target is not None:
            _mend_path(source, path, target)


def _mend_path(source: Element, path: list[Element], target: Element) -> None:
    shapes = [points_of(lane.attrib["shape"]) for lane in path]
    flat = min(shape.shape[1] for shape in shapes)
    shapes = [shape[:, :flat] for shape in shapes]
    enters, leaves = _direction(points_of(source.attrib["shape"])[-2:]), _direction(points_of(target.attrib["shape"]))
    start, end = shapes[0][0], shapes[-1][-1]
    corners = _turn_rad(enters, _direction(shapes[0])), _turn_rad(_direction(shapes[-1][-2:]), leaves)
    chord_m = float(np.hypot(*(end - start)[:2]))
    if chord_m < _SHORTEST_PATH_M and len(path) == 1 and enters @ (end - start)[:2] < 0.0 < enters @ leaves:
        # Roads of an OpenDRIVE map overlap by some centimetres. SUMO would turn vehicles round on the way back.
        ahead = np.append(end[:2] - _SHORTEST_M * leaves, end[2:])
        path[0].set("shape", text_of(np.stack((ahead, end))))
        return
    if chord_m < _SHORTEST_PATH_M or max(corners) < _CORNER_RAD:
        return
    share = np.linspace(0.0, 1.0, _POINTS)[:, None]
    handle_m = _HANDLE * chord_m
    handles = (start[:2], start[:2] + handle_m * enters, end[:2] - handle_m * leaves, end[:2])
    weights = ((1.0 - share) ** 3, 3.0 * share * (1.0 - share) ** 2, 3.0 * share**2 * (1.0 - share), share**3)
    level = sum((weight * point for weight, point in zip(weights, handles, strict=True)), np.zeros((_POINTS, 2)))
    curve = np.concatenate((level, (start + share * (end - start))[:, 2:]), axis=1)
    lengths = [_length_m(shape) for shape in shapes]
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


def _turn_rad(before: Points, after: Points) -> float:
    return float(abs(np.arctan2(before[0] * after[1] - before[1] * after[0], before[:2] @ after[:2])))


def _length_m(points: Points) -> float:
    return float(np.linalg.norm(np.diff(points[:, :2], axis=0), axis=1).sum())


def points_of(shape: str) -> Points:
    """The points of a ``shape`` attribute, shape ``(K, 2)`` or ``(K, 3)``; ValueError where it is none."""
    check_shape(shape)
    rows = [[float(number) for number in point.split(",")] for point in shape.split()]
    flat = min(len(row) for row in rows)
    points = np.array([row[:flat] for row in rows], dtype=np.float64)
    if not (np.abs(points) <= FARTHEST_M).all():
        raise ValueError("a point that is not on Earth")
    return points


def text_of(points: Points) -> str:
    """Writes points as a ``shape`` attribute."""
    return " ".join(",".join(f"{value:.4f}".rstrip("0").rstrip(".") for value in point) for point in points)
