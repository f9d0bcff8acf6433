"""The lanes beside a way: how many there are, and where their centres are across the way."""

from dataclasses import dataclass
from typing import Self

import numpy as np

from siren_ros.base.numerics.arrays import Floats
from siren_ros.simulation.roads.road_network import NO_LANE, RoadNetwork
from siren_ros.simulation.roads.routing import driving_lanes
from siren_ros.simulation.world.traffic_state import Indices


@dataclass(frozen=True)
class LanesBeside:
    """Columns of shape ``(K,)``, one value for each row of a way; offsets are left positive."""

    width_m: Floats
    """Of the lane that the way is in."""
    left: Floats
    """Number of driving lanes of the same direction to the left; fractional in junctions, between both sides…"""
    right: Floats
    """…and to the right."""

    @classmethod
    def of(cls, network: RoadNetwork, way: Indices) -> Self:
        """The lanes beside those of a way, one for each row, on a map where traffic keeps right."""
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
        """Number of the rightmost lane from the way's, left positive."""
        return -round(float(self.right[row]))

    def leftmost(self, row: int) -> int:
        """Number of the leftmost lane, the same way."""
        return round(float(self.left[row]))

    def is_leftmost(self, row: int, lane: int) -> bool:
        """Whether a lane is the leftmost one of several, or would be to the left of it."""
        return lane >= self.leftmost(row) > self.rightmost(row)

    def lane_at(self, row: int, offset_m: float) -> int:
        """Number of the lane from the way's that an offset is in, left positive; also of one that is not there."""
        return round(offset_m / float(self.width_m[row]))

    def lane_there(self, row: int, lane: int) -> int:
        """A lane by its number from the way's, left positive; for one that is not there at a row the last one is."""
        return min(max(lane, self.rightmost(row)), self.leftmost(row))

    def offset_m(self, row: int, lane: int) -> float:
        """Offset of a lane from the way at a row; its number is as for ``lane_there``.

        In junctions the lanes that are on one side only come nearer or go away on the way across.
        """
        there = min(max(float(lane), -float(self.right[row])), float(self.left[row]))
        return there * float(self.width_m[row])
