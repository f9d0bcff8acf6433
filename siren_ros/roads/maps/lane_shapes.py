"""Mends the lanes of a compiled net: corners become bends that a car can follow, lengths are those of the shapes.

netconvert draws bends as polygons with sides of 2 to 10 m, and gives all lanes of an edge one length. SUMO's vehicles
would turn in jerks at every corner, and change their speed where a lane is longer or shorter than its stated length.
"""

from typing import Final
from xml.etree.ElementTree import Element, register_namespace, tostring

import numpy as np
import numpy.typing as npt
from defusedxml.ElementTree import fromstring

from siren_ros.roads.lane_permissions import permissions_of
from siren_ros.roads.maps.junction_paths import mend_junction_paths, points_of, text_of
from siren_ros.roads.net_parser import MAX_MAP_BYTES

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

Points = npt.NDArray[np.float64]


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
