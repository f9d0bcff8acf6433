"""Places along and across the road, as NGSIM has them: x lateral and positive to the right, y forward, lane ids.

NGSIM's sites are straight roads with one frame each. Here every sample has a frame of its own: the tangent of the
target's lane at the present, or its heading off the road, is +y.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from siren_ros.datasets.ngsim.conventions import LANE_WIDTH_M
from siren_ros.judging.lane_location import locate
from siren_ros.numerics.arrays import Floats
from siren_ros.roads.road_network import NO_LANE, LaneKind, RoadNetwork
from siren_ros.world.traffic_state import Indices

Numbers = npt.NDArray[np.int64]
_USED = (LaneKind.DRIVING, LaneKind.INTERNAL, LaneKind.SHOULDER)


@dataclass(frozen=True)
class RoadPlaces:
    """The road at M places; arrays of shape ``(M,)``."""

    tangent_rad: Floats
    lane_number: Numbers
    """1 for the leftmost lane of a road, growing to the right; 0 off the road."""
    lane: Indices
    """Index into ``RoadNetwork.lanes``; NO_LANE off the road."""


def road_places(network: RoadNetwork, xy_m: Floats, yaw_rad: Floats, sumo_lane: Indices) -> RoadPlaces:
    """The road at some poses.

    Args:
        network: The map.
        xy_m: Footprint centres, shape ``(M, 2)``.
        yaw_rad: Headings, shape ``(M,)``.
        sumo_lane: SUMO's lane of each, which decides where lanes overlap; NO_LANE where it is unknown.
    """
    found = locate(network, xy_m, yaw_rad, sumo_lane)
    tangent, number = yaw_rad.copy(), np.zeros(len(yaw_rad), dtype=np.int64)
    numbers = lane_numbers(network)
    for lane in np.unique(found.lane[found.lane != NO_LANE]).tolist():
        there = found.lane == lane
        tangent[there] = network.lanes[lane].centre.heading_rad(found.arc_m[there])
        number[there] = numbers[lane]
    return RoadPlaces(tangent, number, found.lane)


def lane_widths_m(network: RoadNetwork, lane: Indices) -> Floats:
    """Widths of lanes, NGSIM's where there is none; shape ``(M,)``."""
    # NO_LANE is −1 and takes the last width.
    return np.array([one.width_m for one in network.lanes] + [LANE_WIDTH_M])[lane]


def lane_numbers(network: RoadNetwork) -> dict[int, int]:
    """Number of each lane on its edge, from 1 at the left."""
    found = {}
    for edge in network.edges:
        lanes = [index for index in edge.lanes if network.lanes[index].kind in _USED]
        found.update({index: number for number, index in enumerate(reversed(lanes), start=1)})
    return found


def lanes_to_the_right(network: RoadNetwork, lanes: Indices, numbers: Numbers) -> Numbers:
    """How many lanes to the right of its first one a vehicle drives, over its track.

    Only changes between lanes of one edge count: where a road ends, its lanes are numbered anew.
    """
    moved = np.zeros(len(lanes), dtype=np.int64)
    for index in np.flatnonzero(np.diff(lanes)).tolist():
        before, after = int(lanes[index]), int(lanes[index + 1])
        if NO_LANE not in (before, after) and network.lanes[before].edge == network.lanes[after].edge:
            moved[index + 1] = numbers[index + 1] - numbers[index]
    return np.cumsum(moved)


def across_and_ahead(x_m: Any, y_m: Any, tangent_rad: Any) -> tuple[Any, Any]:
    """Offsets in the ``map`` frame as (to the right, ahead) of a direction."""
    cos, sin = np.cos(tangent_rad), np.sin(tangent_rad)
    return x_m * sin - y_m * cos, x_m * cos + y_m * sin


def from_across_and_ahead(right_m: Any, ahead_m: Any, tangent_rad: Any) -> tuple[Any, Any]:
    """The opposite of ``across_and_ahead``: offsets in the ``map`` frame."""
    cos, sin = np.cos(tangent_rad), np.sin(tangent_rad)
    return right_m * sin + ahead_m * cos, ahead_m * sin - right_m * cos
