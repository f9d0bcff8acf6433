"""Mends the paths across junctions of a compiled net: they leave and enter lanes without a corner.

netconvert draws some turning movements of OpenDRIVE maps as straight lines from lane to lane. No car drives the
corners at their ends.
"""

from typing import Final
from xml.etree.ElementTree import Element

import numpy as np
import numpy.typing as npt

from siren_ros.roads.junction_lanes import paths_across
from siren_ros.roads.net_parser import FARTHEST_M, check_shape

_CORNER_RAD: Final = 0.17
"""Change of direction from which the end of a path is a corner (10°)."""
_SHORTEST_M: Final = 2.0
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
    if chord_m < _SHORTEST_M or max(corners) < _CORNER_RAD:
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
