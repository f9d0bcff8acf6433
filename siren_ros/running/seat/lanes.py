"""The lanes beside a path: their number, and the offsets of their centres."""

from dataclasses import dataclass
from typing import Self

import numpy as np

from siren_ros.base.numerics.arrays import Floats
from siren_ros.simulation.roads.road_network import NO_LANE, RoadNetwork
from siren_ros.simulation.roads.routing import driving_lanes
from siren_ros.simulation.world.traffic_state import Indices


@dataclass(frozen=True)
class LanesBeside:
    """Lanes beside a path: columns of shape ``(K,)``, one value per row of the path.

    Offsets are positive to the left.
    """

    width_m: Floats
    """Width of the path's lane."""
    left: Floats
    """Number of driving lanes of the same direction to the left; in junctions it is interpolated between both sides."""
    right: Floats
    """Number of lanes to the right of the path's lane."""

    @classmethod
    def of(cls, network: RoadNetwork, way: Indices) -> Self:
        """Lanes beside the lanes of a path, one per row, on a map with right-hand traffic."""
        s_m = np.arange(float(len(way)))
        columns = np.full((3, len(s_m)), np.nan)
        for row, index in enumerate(way.tolist()):
            lanes = (
                [] if index == NO_LANE else [lane.index for lane in driving_lanes(network, network.lanes[index].edge)]
            )
            if index not in lanes:
                continue
            position = lanes.index(index)
            beside = len(lanes) - 1 - position, position
            columns[:, row] = network.lanes[index].width_m, *beside
        known = np.isfinite(columns[0])
        if not known.any():
            columns[:] = np.array([3.5, 0.0, 0.0])[:, None]
        else:
            columns = np.array([np.interp(s_m, s_m[known], column[known]) for column in columns])
        return cls(*columns)

    def rightmost(self, row: int) -> int:
        """Number of the rightmost lane, counted from the path's lane, positive to the left."""
        return -round(float(self.right[row]))

    def leftmost(self, row: int) -> int:
        """Number of the leftmost lane, counted from the path's lane."""
        return round(float(self.left[row]))

    def is_leftmost(self, row: int, lane: int) -> bool:
        """Whether a lane is the leftmost of several, or would be left of it."""
        return lane >= self.leftmost(row) > self.rightmost(row)

    def lane_at(self, row: int, offset_m: float) -> int:
        """Number of the lane at an offset, counted from the path's lane, also outside the road."""
        return round(offset_m / float(self.width_m[row]))

    def lane_there(self, row: int, lane: int) -> int:
        """Nearest existing lane at a row, by its number from the path's lane."""
        return min(max(lane, self.rightmost(row)), self.leftmost(row))

    def offset_m(self, row: int, lane: int) -> float:
        """Lateral distance of a lane from the path at a row. The lane is given by its number from the path's lane.

        In a junction, a lane that exists only before or only after it moves towards the path or away from it.
        """
        there = min(max(float(lane), -float(self.right[row])), float(self.left[row]))
        return there * float(self.width_m[row])
