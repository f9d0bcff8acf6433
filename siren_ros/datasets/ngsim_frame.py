"""NGSIM's conventions: units, classes, places along and across the road, the social grid and manoeuvre classes.

NGSIM's sites are straight roads with one frame each: x lateral and positive to the right, y forward. Here every sample
has a frame of its own: the tangent of the target's lane at the present, or its heading off the road, is +y. Grid and
manoeuvres: Deo and Trivedi 2018, ``preprocess_data.m`` of the published loaders.
"""

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from siren_ros.numerics.arrays import Floats, Rows
from siren_ros.record.vehicle_location import locate
from siren_ros.roads.road_network import NO_LANE, LaneKind, RoadNetwork
from siren_ros.world.actors import ActorClass
from siren_ros.world.traffic_state import Indices

FOOT_M: Final = 0.3048
LANE_WIDTH_M: Final = 3.5
"""Of vehicles off the road."""
_CAR, _TRUCK = 2, 3
_TRUCKS: Final = frozenset({ActorClass.TRUCK, ActorClass.BUS, ActorClass.FIRE_TRUCK})
Numbers = npt.NDArray[np.int64]
_USED = (LaneKind.DRIVING, LaneKind.INTERNAL, LaneKind.SHOULDER)
COLUMNS: Final = 3
CELLS_ALONG: Final = 13
CELLS: Final = COLUMNS * CELLS_ALONG
_CELL_FT: Final = 15.0
_REACH_FT: Final = 90.0
OUTSIDE: Final = -1
"""No cell of the grid."""
LATERAL_WINDOW_FRAMES: Final = 40
"""A lane change within 4 s before or after the present makes a manoeuvre."""
HISTORY_FRAMES: Final = 30
FUTURE_FRAMES: Final = 50
_BRAKE: Final = 0.8
_ACCELERATE: Final = 1.25
KEEP, LEFT, RIGHT = 1, 2, 3
NORMAL, BRAKE, ACCELERATE = 1, 2, 3


def vehicle_class(actor_class: ActorClass) -> int:
    """NGSIM's class of a vehicle: 2 a car, 3 a truck; 1 would be a motorcycle."""
    return _TRUCK if actor_class in _TRUCKS else _CAR


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
    places = locate(network, xy_m, yaw_rad, sumo_lane)
    tangent, number = yaw_rad.copy(), np.zeros(len(yaw_rad), dtype=np.int64)
    numbers = lane_numbers(network)
    for lane in np.unique(places.lane[places.lane != NO_LANE]).tolist():
        there = places.lane == lane
        tangent[there] = network.lanes[lane].centre.heading_rad(places.arc_m[there])
        number[there] = numbers[lane]
    return RoadPlaces(tangent, number, places.lane)


def lane_widths_m(network: RoadNetwork, lane: Indices) -> Floats:
    """Widths of lanes, NGSIM's where there is none; shape ``(M,)``."""
    # NO_LANE is −1 and takes the last width.
    return np.array([lane_of_network.width_m for lane_of_network in network.lanes] + [LANE_WIDTH_M])[lane]


def lane_numbers(network: RoadNetwork) -> dict[int, int]:
    """Number of each lane on its edge, from 1 at the left."""
    numbers = {}
    for edge in network.edges:
        lanes = [index for index in edge.lanes if network.lanes[index].kind in _USED]
        numbers.update({index: number for number, index in enumerate(reversed(lanes), start=1)})
    return numbers


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


def grid_cells(lane_offset: Floats, ahead_ft: Floats) -> Rows:
    """Cells of neighbours, 0 to 38, and ``OUTSIDE``; all arrays of shape ``(P,)``.

    Args:
        lane_offset: −1 in the lane to the left, 0 in the own lane, +1 in the lane to the right.
        ahead_ft: How far ahead of the target they are.
    """
    # Halves away from zero, as the published loader rounds.
    along = np.minimum(np.floor((ahead_ft + _REACH_FT) / _CELL_FT + 0.5), CELLS_ALONG - 1)
    outside = (np.abs(lane_offset) > 1.0) | (np.abs(ahead_ft) >= _REACH_FT) | ((lane_offset == 0.0) & (ahead_ft == 0.0))
    return np.where(outside, OUTSIDE, (lane_offset + 1.0) * CELLS_ALONG + along).astype(np.intp)


def neighbour_cells(right_m: Floats, ahead_m: Floats, turned_rad: Floats, width_m: Floats) -> Rows:
    """Cells of vehicles around a target, and ``OUTSIDE``; all arrays of shape ``(P,)``.

    Vehicles of another direction are no neighbours: NGSIM's roads have one.

    Args:
        right_m: How far to the right of the target they are, seen along the target's lane.
        ahead_m: How far ahead of it.
        turned_rad: Their heading against that of the target's lane.
        width_m: Width of the target's lane.
    """
    cells = grid_cells(np.round(right_m / width_m), ahead_m / FOOT_M)
    return np.where(np.cos(turned_rad) > 0.0, cells, OUTSIDE)


def lateral_class(lane_number: Numbers, present: int) -> int:
    """Whether a vehicle keeps its lane, changes to the left or to the right around the present.

    Args:
        lane_number: Lanes of its track, counted to the right.
        present: Index of the present.
    """
    first = lane_number[max(0, present - LATERAL_WINDOW_FRAMES)]
    last = lane_number[min(len(lane_number) - 1, present + LATERAL_WINDOW_FRAMES)]
    now = lane_number[present]
    if last > now or now > first:
        return RIGHT
    return LEFT if last < now or now < first else KEEP


def longitudinal_class(ahead_ft: Floats, present: int) -> int:
    """Whether a vehicle brakes, accelerates or neither: its mean speed in the next 5 s against the last 3 s.

    Args:
        ahead_ft: Distance travelled along its track.
        present: Index of the present.
    """
    first, last = max(0, present - HISTORY_FRAMES), min(len(ahead_ft) - 1, present + FUTURE_FRAMES)
    if present in {first, last}:
        return NORMAL
    past = (ahead_ft[present] - ahead_ft[first]) / (present - first)
    coming = (ahead_ft[last] - ahead_ft[present]) / (last - present)
    if past < 1e-6:
        return ACCELERATE if coming > 1e-3 else NORMAL
    ratio = coming / past
    return BRAKE if ratio < _BRAKE else ACCELERATE if ratio > _ACCELERATE else NORMAL
