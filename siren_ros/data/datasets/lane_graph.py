"""Lanes in the form that trajectory datasets need: boundaries, successors, neighbours and paths across junctions."""

from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from shapely.geometry import LineString, Polygon
from shapely.ops import split

from siren_ros.base.numerics.arrays import Points
from siren_ros.data.record.vehicle_location import DRIVEN_KINDS
from siren_ros.sensing.scene.surfaces import polygons
from siren_ros.simulation.roads.road_network import Lane, LaneKind, RoadNetwork


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
