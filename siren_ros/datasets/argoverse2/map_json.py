"""Argoverse 2's vector map: lane segments, drivable areas, pedestrian crossings.

Format: https://github.com/argoverse/av2-api, ``src/av2/map``. Coordinates are the ``map`` frame's: right-handed.
"""

from typing import Any, Final

import numpy as np
from shapely.geometry import Polygon
from shapely.ops import unary_union

from siren_ros.datasets.sources.lane_graph import GraphLane, lane_graph
from siren_ros.numerics.arrays import Points
from siren_ros.roads.road_network import LaneKind, RoadNetwork

_SEGMENT_POINTS: Final = 10
"""Argoverse 2 gives boundaries and centre lines ten points; longer lanes get one more every five metres."""
_SPACING_M: Final = 5.0
_SIMPLE_M: Final = 0.05


def map_json(network: RoadNetwork) -> dict[str, Any]:
    """The archive of a map as JSON types."""
    graph = lane_graph(network)
    return {
        "pedestrian_crossings": {
            str(index): _crossing(index, outline)
            for index, outline in enumerate(network.crossings)
            if len(outline) >= 4
        },
        "lane_segments": {str(index): _segment(index, lane, graph) for index, lane in graph.items()},
        "drivable_areas": {
            str(index): {"id": index, "area_boundary": _points(area)}
            for index, area in enumerate(drivable_areas(network, graph))
        },
    }


def _segment(index: int, found: GraphLane, graph: dict[int, GraphLane]) -> dict[str, Any]:
    count = max(_SEGMENT_POINTS, int(found.lane.length_m / _SPACING_M) + 1)
    left, right = found.left_neighbour, found.right_neighbour
    inside = found.in_junction
    return {
        "id": index,
        "is_intersection": inside,
        "lane_type": "BUS" if found.lane.kind is LaneKind.SHOULDER else "VEHICLE",
        "centerline": _points(resampled(found.lane.centre.points, count)),
        "left_lane_boundary": _points(resampled(found.left, count)),
        "right_lane_boundary": _points(resampled(found.right, count)),
        "left_lane_mark_type": "NONE" if inside else "SOLID_YELLOW" if left is None else "DASHED_WHITE",
        "right_lane_mark_type": "NONE" if inside else "SOLID_WHITE" if right is None else "DASHED_WHITE",
        "successors": [one for one in found.successors if one in graph],
        "predecessors": [one for one in found.predecessors if one in graph],
        "left_neighbor_id": left,
        "right_neighbor_id": right,
    }


def resampled(points: Points, count: int) -> Points:
    """The same line by some points at equal distances; shape ``(count, 2)``."""
    step = np.hypot(*np.diff(points, axis=0).T)
    arc = np.concatenate(([0.0], np.cumsum(step)))
    wanted = np.linspace(0.0, arc[-1], count)
    return np.stack([np.interp(wanted, arc, points[:, axis]) for axis in (0, 1)], axis=-1)


def drivable_areas(network: RoadNetwork, graph: dict[int, GraphLane]) -> list[Points]:
    """Outlines of lanes and junctions as one area; holes stay open by being left out, as Argoverse 2 has none."""
    shapes = [Polygon(np.vstack((lane.left, lane.right[::-1]))).buffer(0.0) for lane in graph.values()]
    shapes += [Polygon(one.outline).buffer(0.0) for one in network.junctions.values() if len(one.outline) >= 3]
    joined = unary_union([shape.buffer(_SIMPLE_M) for shape in shapes if not shape.is_empty]).simplify(_SIMPLE_M)
    areas = []
    for part in getattr(joined, "geoms", [joined]):
        areas += [np.array(piece.exterior.coords) for piece in _without_holes(part)]
    return areas


def _without_holes(polygon: Polygon) -> list[Polygon]:
    """Pieces without holes that together are the polygon: it is cut through its holes."""
    if not polygon.interiors:
        return [polygon]
    x = Polygon(polygon.interiors[0]).centroid.x
    low_x, low_y, high_x, high_y = polygon.bounds
    pieces = []
    for start, end in ((low_x, x), (x, high_x)):
        side = Polygon([(start, low_y), (end, low_y), (end, high_y), (start, high_y)])
        cut = polygon.intersection(side)
        for part in getattr(cut, "geoms", [cut]):
            if isinstance(part, Polygon) and part.area > _SIMPLE_M:
                pieces += _without_holes(part)
    return pieces


def _crossing(index: int, outline: Points) -> dict[str, Any]:
    """Its two long edges, which run in one direction."""
    a, b, c, d = outline[:4]
    edges = ((a, b), (d, c)) if np.hypot(*(b - a)) >= np.hypot(*(c - b)) else ((b, c), (a, d))
    return {"id": index, "edge1": _points(np.array(edges[0])), "edge2": _points(np.array(edges[1]))}


def _points(points: Points) -> list[dict[str, float]]:
    return [{"x": round(float(x), 3), "y": round(float(y), 3), "z": 0.0} for x, y in points]
