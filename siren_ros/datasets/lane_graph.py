"""Lanes as trajectory datasets want them: boundaries, successors and neighbours, paths across junctions included."""

from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np

from siren_ros.numerics.arrays import Points
from siren_ros.roads.road_network import Lane, LaneKind, RoadNetwork

DRIVEN: Final = frozenset({LaneKind.DRIVING, LaneKind.SHOULDER, LaneKind.INTERNAL})


@dataclass(frozen=True)
class GraphLane:
    """One lane that vehicles use; the others are named by their indices in the road network."""

    lane: Lane
    left: Points
    """Left boundary in driving direction, as many points as the centre line, shape ``(K, 2)``."""
    right: Points
    successors: tuple[int, ...]
    predecessors: tuple[int, ...]
    left_neighbour: int | None
    """The lane to the left on the same edge, which runs in the same direction."""
    right_neighbour: int | None

    @property
    def in_junction(self) -> bool:
        """Whether it is a path across a junction."""
        return self.lane.kind is LaneKind.INTERNAL


def lane_graph(network: RoadNetwork) -> dict[int, GraphLane]:
    """The lanes that vehicles use, by index, in the order of the network."""
    after: dict[int, set[int]] = {}
    for connection in network.connections:
        chain = (connection.from_lane, *connection.via, connection.to_lane)
        for first, second in pairwise(chain):
            after.setdefault(first, set()).add(second)
    before: dict[int, set[int]] = {}
    for first, seconds in after.items():
        for second in seconds:
            before.setdefault(second, set()).add(first)
    driven = {lane.index for lane in network.lanes if lane.kind in DRIVEN}

    def known(lanes: set[int]) -> tuple[int, ...]:
        return tuple(sorted(lanes & driven))

    def neighbour(lane: Lane, side: int) -> int | None:
        beside = network.neighbour(lane, side)
        return beside.index if beside is not None and beside.index in driven else None

    return {
        index: GraphLane(
            lane=(lane := network.lanes[index]),
            left=offset_line(lane.centre.points, lane.width_m / 2.0),
            right=offset_line(lane.centre.points, -lane.width_m / 2.0),
            successors=known(after.get(index, set())),
            predecessors=known(before.get(index, set())),
            left_neighbour=neighbour(lane, 1),
            right_neighbour=neighbour(lane, -1),
        )
        for index in sorted(driven)
    }


def offset_line(points: Points, left_m: float) -> Points:
    """A line moved to its left, vertex by vertex along the mean of the normals there; shape of ``points``."""
    along = np.diff(points, axis=0)
    length = np.hypot(along[:, 0], along[:, 1])
    unit = along / np.where(length == 0.0, 1.0, length)[:, None]
    tangent = np.vstack((unit[:1], unit[:-1] + unit[1:], unit[-1:]))
    size = np.hypot(tangent[:, 0], tangent[:, 1])
    tangent /= np.where(size < 1e-9, 1.0, size)[:, None]
    moved: Points = points + left_m * np.stack((-tangent[:, 1], tangent[:, 0]), axis=-1)
    return moved
