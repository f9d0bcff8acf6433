"""Finds the lane of a vehicle on its route, from its pose alone.

SUMO's own matching may choose a wrong path across a junction where paths overlap. A vehicle that is
moved from outside therefore gets its lane from here.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from siren_ros.numerics.compiled import compiled
from siren_ros.numerics.scalars import within, wrapped_rad
from siren_ros.roads.road_network import NO_LANE, Lane, LaneKind, RoadNetwork

_DRIVABLE = frozenset({LaneKind.DRIVING, LaneKind.SHOULDER, LaneKind.INTERNAL})


@dataclass(frozen=True)
class LaneMatch:
    """Where a point is on the road."""

    lane: int
    """Index into ``RoadNetwork.lanes``; −1 off the route's lanes."""
    position_m: float
    lateral_m: float
    """From the centre line, left positive."""


OFF_ROUTE = LaneMatch(NO_LANE, 0.0, 0.0)


class _Corridor(NamedTuple):
    """All centre-line segments of some lanes."""

    start: npt.NDArray[np.float64]
    length_m: npt.NDArray[np.float64]
    unit: npt.NDArray[np.float64]
    """Direction of each segment."""
    heading_rad: npt.NDArray[np.float64]
    arc_m: npt.NDArray[np.float64]
    lane: npt.NDArray[np.int32]
    edge: npt.NDArray[np.int32]
    reach_m: npt.NDArray[np.float64]
    """Distance from the centre line up to which a point belongs to the lane."""


class LaneMatcher:
    """Matches poses to the lanes of the next edges of a route."""

    def __init__(
        self,
        network: RoadNetwork,
        sideways_m: float = 1.2,
        junction_sideways_m: float = 5.0,
        heading_limit_rad: float = 1.2,
        stay_m: float = 0.1,
    ) -> None:
        """Prepare matching.

        Args:
            network: The map.
            sideways_m: A point at most this far outside a lane's edge still belongs to it.
            junction_sideways_m: The same on junctions, which are road between the paths too; libsumo 1.28 was seen to
                crash with a vehicle taken off the road there.
            heading_limit_rad: Lanes that run further off the vehicle's heading are left out.
            stay_m: A neighbour of the present lane takes over where it is nearer by this much.
        """
        self._network = network
        self._sideways_m = sideways_m
        self._junction_sideways_m = junction_sideways_m
        self._heading_limit_rad = heading_limit_rad
        self._stay_m = stay_m
        self._corridors: dict[tuple[int, ...], _Corridor] = {}

    def match(self, edges: Sequence[int], front_m: tuple[float, float], yaw_rad: float, present_lane: int) -> LaneMatch:
        """The lane under a front bumper.

        Args:
            edges: The route's next edges, the present one (or the one before the junction) first.
            front_m: The middle of the front bumper in the ``map`` frame.
            yaw_rad: Heading of the vehicle.
            present_lane: Lane at the step before, −1 where unknown.
        """
        key = tuple(edges)
        if key not in self._corridors:
            self._corridors[key] = self._corridor(key)
        corridor = self._corridors[key]
        edge = NO_LANE if present_lane == NO_LANE else self._network.lanes[present_lane].edge
        best, along_m, lateral_m = _nearest(
            corridor, front_m, yaw_rad, self._heading_limit_rad, (edge, present_lane, self._stay_m)
        )
        if best < 0:
            return OFF_ROUTE
        return LaneMatch(int(corridor.lane[best]), float(corridor.arc_m[best] + along_m), lateral_m)

    def _corridor(self, edges: tuple[int, ...]) -> _Corridor:
        indices: list[int] = []
        for number, edge in enumerate(edges):
            indices += self._network.edges[edge].lanes
            following = edges[number + 1] if number + 1 < len(edges) else None
            for lane in self._network.edges[edge].lanes:
                for connection in self._network.connections_from.get(lane, ()):
                    if self._network.lanes[connection.to_lane].edge == following:
                        indices += connection.via
        lanes = [self._network.lanes[index] for index in dict.fromkeys(indices)]
        lanes = [lane for lane in lanes if lane.kind in _DRIVABLE]
        counts = [len(lane.centre.points) - 1 for lane in lanes]
        delta = np.concatenate([np.diff(lane.centre.points, axis=0) for lane in lanes])
        length = np.hypot(delta[:, 0], delta[:, 1])
        return _Corridor(
            start=np.concatenate([lane.centre.points[:-1] for lane in lanes]),
            length_m=length,
            unit=delta / length[:, None],
            heading_rad=np.arctan2(delta[:, 1], delta[:, 0]),
            arc_m=np.concatenate([lane.centre.arc_m[:-1] for lane in lanes]),
            lane=np.repeat(np.array([lane.index for lane in lanes], dtype=np.int32), counts),
            edge=np.repeat(np.array([lane.edge for lane in lanes], dtype=np.int32), counts),
            reach_m=np.repeat([self._reach_m(lane) for lane in lanes], counts),
        )

    def _reach_m(self, lane: Lane) -> float:
        beside_m = self._junction_sideways_m if lane.kind is LaneKind.INTERNAL else self._sideways_m
        return lane.width_m / 2.0 + beside_m


@compiled
def _nearest(
    corridor: _Corridor, front_m: tuple[float, float], yaw_rad: float, limit_rad: float, present: tuple[int, int, float]
) -> tuple[int, float, float]:
    """The segment under a front bumper, −1 where there is none; the place along it and beside it, left positive.

    ``present`` holds the vehicle's edge and lane, and how much nearer another lane of that edge has to be.
    """
    edge, lane, stay_m = present
    best, best_m, best_along, best_left = -1, np.inf, 0.0, 0.0
    for k in range(corridor.length_m.shape[0]):
        x, y = front_m[0] - corridor.start[k, 0], front_m[1] - corridor.start[k, 1]
        unit_x, unit_y = corridor.unit[k, 0], corridor.unit[k, 1]
        along = within(x * unit_x + y * unit_y, 0.0, corridor.length_m[k])
        distance = np.hypot(x - along * unit_x, y - along * unit_y)
        if distance > corridor.reach_m[k] or abs(wrapped_rad(corridor.heading_rad[k] - yaw_rad)) > limit_rad:
            continue
        if corridor.edge[k] == edge and corridor.lane[k] != lane:
            distance += stay_m
        if distance < best_m:
            best, best_m, best_along, best_left = k, distance, along, unit_x * y - unit_y * x
    return best, best_along, best_left
