"""Lanes in the form that datasets need: boundaries, successors, neighbours and paths, and lanelets without gaps.

CommonRoad's tools take the union of all lanelets for the road and everything else for an obstacle. So a slit between
two lanelets, or the middle of a junction that no path crosses, would stop a vehicle that drives over it. Lanelets
therefore cover the road's surface: neighbours share a boundary, successors join.
"""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np
import shapely
from shapely.geometry import LineString, Polygon
from shapely.ops import split

from siren_ros.base.numerics.arrays import Floats, Points
from siren_ros.data.tracks import DRIVEN_KINDS
from siren_ros.sensing.scene.surfaces import closed, polygons
from siren_ros.simulation.roads.road_network import Lane, LaneKind, RoadNetwork
from siren_ros.simulation.scenario.driver_parameters import PullOverConfig


@dataclass(frozen=True)
class GraphLane:
    """One lane that vehicles use; indices of the road network name the other lanes."""

    lane: Lane
    left: Points
    """Left boundary in driving direction, with as many points as the centre line, shape ``(K, 2)``."""
    right: Points
    successors: tuple[int, ...]
    predecessors: tuple[int, ...]
    left_neighbour: int | None
    """The lane to the left on the same edge, which runs in the same direction."""
    right_neighbour: int | None
    left_hand: bool = False
    """Whether traffic keeps left, so that oncoming traffic is on the right."""

    @property
    def inner(self) -> Points:
        """The boundary towards oncoming traffic."""
        return self.right if self.left_hand else self.left

    @property
    def outline(self) -> Points:
        """Corners of the lane's area: the left boundary, then the right one backwards; shape ``(2 K, 2)``."""
        outline: Points = np.concatenate((self.left, self.right[::-1]))
        return outline

    @property
    def in_junction(self) -> bool:
        """Whether the lane is a path across a junction."""
        return self.lane.kind is LaneKind.INTERNAL


def lane_graph(network: RoadNetwork) -> dict[int, GraphLane]:
    """The lanes that vehicles use, by index, in the order of the network."""
    after, before = defaultdict[int, set[int]](set), defaultdict[int, set[int]](set)
    for connection in network.connections:
        for first, second in pairwise((connection.from_lane, *connection.via, connection.to_lane)):
            after[first].add(second)
            before[second].add(first)
    driven = {lane.index for lane in network.lanes if lane.kind in DRIVEN_KINDS}

    def neighbour(lane: Lane, side: int) -> int | None:
        beside = network.neighbour(lane, side)
        return beside.index if beside is not None and beside.index in driven else None

    return {
        index: GraphLane(
            lane=(lane := network.lanes[index]),
            left=offset_line(lane.centre.points, lane.width_m / 2.0),
            right=offset_line(lane.centre.points, -lane.width_m / 2.0),
            successors=tuple(sorted(after[index] & driven)),
            predecessors=tuple(sorted(before[index] & driven)),
            left_neighbour=neighbour(lane, 1),
            right_neighbour=neighbour(lane, -1),
            left_hand=network.left_hand,
        )
        for index in sorted(driven)
    }


def offset_line(points: Points, left_m: float) -> Points:
    """A line shifted to its left: each vertex moves along the mean of the normals there; same shape as ``points``."""
    along = np.diff(points, axis=0)
    length = np.hypot(along[:, 0], along[:, 1])
    unit = along / np.where(length == 0.0, 1.0, length)[:, None]
    tangent = np.vstack((unit[:1], unit[:-1] + unit[1:], unit[-1:]))
    size = np.hypot(tangent[:, 0], tangent[:, 1])
    tangent /= np.where(size < 1e-9, 1.0, size)[:, None]
    moved: Points = points + left_m * np.stack((-tangent[:, 1], tangent[:, 0]), axis=-1)
    return moved


def driven_shapes(network: RoadNetwork, graph: Mapping[int, GraphLane]) -> list[Polygon]:
    """The areas of all lanes that vehicles use, and of the junctions."""
    outlines = [lane.outline for lane in graph.values()]
    outlines += [junction.outline for junction in network.junctions.values() if len(junction.outline) > 2]
    return [Polygon(outline).buffer(0.0) for outline in outlines]


def without_holes(area: Polygon, smallest_m2: float) -> list[Polygon]:
    """Split an area by cuts through the middle of its holes, for formats whose areas have none.

    Pieces that are smaller than ``smallest_m2`` are left out.
    """
    if not area.interiors:
        return [area]
    _, south, _, north = area.bounds
    x = Polygon(area.interiors[0]).centroid.x
    parts = split(area, LineString([(x, south - 1.0), (x, north + 1.0)]))
    return [piece for part in polygons(parts, smallest_m2) for piece in without_holes(part, smallest_m2)]


BORDER_M: Final = PullOverConfig().overhang_max_m
"""Width of the strip beside a road over which a vehicle's body may reach when its driver makes way."""
_ONE_LINE_M: Final = 0.5
"""Boundaries of neighbours nearer than this are one line; for the ends of successors the limit is twice this."""
_STRAIGHT_M: Final = 0.005
"""A vertex is left out if no boundary moves by more than this."""
_CORNER_M: Final = 4.0
"""Gaps between the paths across a junction are paved if they are narrower than twice this, as in the 3-D scene."""
_MOUTH_M: Final = 3.0
"""Length of the lane ends that count as part of a junction."""
_OVERLAP_M: Final = 0.2
"""How far a junction's surface reaches into its roads."""
_SMALLEST_M2: Final = 0.01


@dataclass
class Bounds:
    """Both boundaries of a lanelet in driving direction, with equally many points, shape ``(K, 2)``."""

    left: Points
    right: Points

    @classmethod
    def around(cls, area: Polygon) -> "Bounds":
        """The boundaries of an area without holes, from its first corner to the corner farthest from it."""
        ring = shapely.get_coordinates(area.exterior)[:: -1 if area.exterior.is_ccw else 1]
        furthest = int(np.hypot(*(ring - ring[0]).T).argmax())
        (left, right), _ = _at_common_shares((ring[: furthest + 1], ring[furthest:][::-1]))
        return cls(left, right)

    @property
    def turned(self) -> "Bounds":
        """The boundaries of the opposite driving direction."""
        return Bounds(self.right[::-1], self.left[::-1])

    def polygon(self) -> Polygon:
        """The area between the boundaries."""
        return Polygon(np.concatenate((self.left, self.right[::-1])))


def lanelet_bounds(graph: Mapping[int, GraphLane], opposite: Mapping[int, int]) -> dict[int, Bounds]:
    """The boundaries of each lane, joined to those of its neighbours, successors and predecessors.

    ``opposite`` names the lane of the other direction that shares the left boundary of a lane.
    """
    bounds_of_lane: dict[int, Bounds] = {}
    for index, lane in graph.items():
        if lane.right_neighbour is None and index not in bounds_of_lane:
            ahead = _leftwards(graph, index)
            back: list[int] = []
            other = opposite.get(ahead[-1])
            if other is not None and opposite.get(other) == ahead[-1]:
                back = _leftwards(graph, _rightmost(graph, other))[::-1]
            oncoming = [_unfolded(graph[key]).turned for key in back]
            bounds = _shared([*(_unfolded(graph[key]) for key in ahead), *oncoming])
            bounds_of_lane.update(zip(ahead, bounds, strict=False))
            bounds_of_lane.update((key, turned.turned) for key, turned in zip(back, bounds[len(ahead) :], strict=True))
    for index, lane in graph.items():
        _join_ends(bounds_of_lane, index, lane, graph)
    return bounds_of_lane


def _leftwards(graph: Mapping[int, GraphLane], index: int) -> list[int]:
    group = [index]
    while (left := graph[group[-1]].left_neighbour) is not None:
        group.append(left)
    return group


def _rightmost(graph: Mapping[int, GraphLane], index: int) -> int:
    while (right := graph[index].right_neighbour) is not None:
        index = right
    return index


def _shared(lanes: Sequence[Bounds]) -> list[Bounds]:
    """Boundaries of the lanes of one road from right to left; all have vertices at the same positions."""
    lines = [line for lane in lanes for line in (lane.right, lane.left)]
    moved, common = _at_common_shares(lines)
    for left, right in zip(range(1, len(lines) - 1, 2), range(2, len(lines), 2), strict=True):
        if np.hypot(*(moved[left] - moved[right]).T).max() < _ONE_LINE_M:
            moved[left] = moved[right] = (moved[left] + moved[right]) / 2.0
    kept = _needed(np.concatenate(moved, axis=1), common)
    return [Bounds(left[kept], right[kept]) for right, left in zip(moved[::2], moved[1::2], strict=True)]


def _unfolded(lane: GraphLane) -> Bounds:
    """Boundaries of a lane. In a bend tighter than half the lane's width the inner boundary must not run backwards."""
    bounds = Bounds(lane.left, lane.right)
    if bounds.polygon().is_valid:
        return bounds
    centre, half_m = LineString(lane.lane.centre.points), lane.lane.width_m / 2.0
    shares = np.linspace(0.0, 1.0, len(lane.left))
    for side, name in ((half_m, "left"), (-half_m, "right")):
        line = centre.offset_curve(side, join_style="mitre", mitre_limit=2.0)
        if isinstance(line, LineString) and not line.is_empty:
            setattr(bounds, name, shapely.get_coordinates(line.interpolate(shares, normalized=True)))
    return bounds


def _shares(line: Points) -> Floats:
    """Position of each vertex along a line, from 0 to 1."""
    way = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(line, axis=0).T))))
    return way / way[-1] if way[-1] > 0.0 else np.linspace(0.0, 1.0, len(line))


def _at_common_shares(lines: Sequence[Points]) -> tuple[list[Points], Floats]:
    """Give all lines vertices at the same positions; returns the lines and these positions."""
    shares = [_shares(line) for line in lines]
    common = np.unique(np.concatenate(shares).round(9))
    moved = [
        np.stack([np.interp(common, share, line[:, axis]) for axis in (0, 1)], axis=-1)
        for line, share in zip(lines, shares, strict=True)
    ]
    return moved, common


def _needed(lines: Floats, share: Floats) -> list[int]:
    """Vertices needed to keep the shape of several parallel lines (Douglas and Peucker's algorithm)."""
    kept, open_spans = {0, len(share) - 1}, [(0, len(share) - 1)]
    while open_spans:
        first, last = open_spans.pop()
        if last - first < 2:
            continue
        part = (share[first + 1 : last] - share[first]) / (share[last] - share[first])
        off = lines[first + 1 : last] - lines[first] - part[:, None] * (lines[last] - lines[first])
        furthest = np.hypot(off[:, ::2], off[:, 1::2]).max(axis=1)
        if furthest.max() > _STRAIGHT_M:
            middle = first + 1 + int(furthest.argmax())
            kept.add(middle)
            open_spans += [(first, middle), (middle, last)]
    return sorted(kept)


def _join_ends(
    bounds_of_lane: Mapping[int, Bounds], index: int, lane: GraphLane, graph: Mapping[int, GraphLane]
) -> None:
    """Move the start of a lane to the end of its predecessor, and the end of a path to the start of its road."""
    bounds = bounds_of_lane[index]
    before = sorted(lane.predecessors, key=lambda other: graph[other].in_junction)
    roads = [other for other in lane.successors if not graph[other].in_junction]
    for others, mine, theirs in (
        (before if lane.in_junction else [], 0, -1),
        (roads if lane.in_junction else [], -1, 0),
    ):
        for other in others[:1]:
            places = bounds_of_lane[other].left[theirs], bounds_of_lane[other].right[theirs]
            moved = max(np.hypot(*(places[0] - bounds.left[mine])), np.hypot(*(places[1] - bounds.right[mine])))
            if moved < 2.0 * _ONE_LINE_M:
                bounds.left[mine], bounds.right[mine] = places


def border_strips(
    graph: Mapping[int, GraphLane], bounds: Mapping[int, Bounds], opposite: Mapping[int, int]
) -> list[Bounds]:
    """Strips beside the roads over which a vehicle's body may reach, in driving direction."""
    strips = []
    for index, lane in graph.items():
        if lane.in_junction:
            continue
        lanelet = bounds[index]
        if lane.right_neighbour is None:
            strips.append(Bounds(lanelet.right, offset_line(lanelet.right, -BORDER_M)))
        if lane.left_neighbour is None and index not in opposite:
            strips.append(Bounds(offset_line(lanelet.left, BORDER_M), lanelet.left))
    return strips


def junction_surfaces(network: RoadNetwork, bounds: Mapping[int, Bounds]) -> list[Bounds]:
    """The paved part of each junction: its paths, the ends of its lanes, and the gaps between these."""
    areas = [lanelet.polygon().buffer(0.0) for lanelet in bounds.values()]
    tree = shapely.STRtree(areas)
    surfaces = []
    for junction in network.junctions.values():
        if len(junction.outline) < 3:
            continue
        outline = Polygon(junction.outline).buffer(0.0)
        around = outline.buffer(_MOUTH_M)
        parts = [shapely.intersection(areas[row], around) for row in sorted(tree.query(outline.buffer(_OVERLAP_M)))]
        driven = shapely.union_all(parts)
        paved = shapely.union(driven, closed(driven, _CORNER_M))
        for part in polygons(shapely.intersection(paved, outline.buffer(_OVERLAP_M)), _SMALLEST_M2):
            surfaces += [Bounds.around(piece) for piece in without_holes(part, _SMALLEST_M2)]
    return surfaces
