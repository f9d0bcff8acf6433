"""L3 next to a shoulder on which an EMV comes: who is where it should be already."""

from typing import Final

import numpy as np

from siren_ros.behaviour.civilians.unit import aligned_within_rad
from siren_ros.behaviour.driving.lane_change import offset_in_lane
from siren_ros.behaviour.driving.situation import StepView
from siren_ros.behaviour.paths.lane_path import neighbour_lane
from siren_ros.behaviour.paths.shoulder_way import shoulder_into_turn
from siren_ros.roads.movements import road_lane_of
from siren_ros.roads.road_network import NO_LANE, LaneKind
from siren_ros.world.actors import rows_of_ids

_STOPS_MPS: Final = 1.5
"""Slower vehicles next to a shoulder that they leave free stop where they are."""
_ALONGSIDE_M: Final = 15.0
"""Distance along the road within which the driver next to a vehicle gives it space to move sideways."""


def may_stay(view: StepView, row: int, lane: int) -> bool:
    """Whether a vehicle in a lane before the EMV's shoulder stands, or nearly, and leaves the EMV its way."""
    return bool(view.seen.speed_mps[row] < _STOPS_MPS) and _leaves_shoulder_free(view, row, lane)


def emv_takes_shoulder(view: StepView, lane: int, emv_id: int) -> bool:
    """Whether the way of the EMV, whose turn signal is on, is the shoulder: everybody there goes to the left."""
    network = view.world.network
    (row,) = rows_of_ids(view.seen.actor_id, np.array([emv_id], dtype=np.uint32)).tolist()
    if row < 0:
        return False
    way = shoulder_into_turn(network, view.traffic.route_of_row(row), view.world.config.corridor.shoulder_reach_m)
    return way is not None and network.lanes[road_lane_of(network, lane)].edge in way.edges


def _leaves_shoulder_free(view: StepView, row: int, lane: int) -> bool:
    """Whether a vehicle leaves an EMV's width between its right side and the outer edge of the shoulder.

    In the lanes farther left the vehicles leave it free where those on their right do.
    """
    network = view.world.network
    lane = road_lane_of(network, lane)
    right = neighbour_lane(network, lane, -1)
    if right == NO_LANE:
        return False
    if network.lanes[right].kind is LaneKind.DRIVING:
        apart = np.abs(view.traffic.lane_position_m - view.traffic.lane_position_m[row])
        near = np.flatnonzero((view.traffic.lane == right) & (apart < _ALONGSIDE_M))
        return all(_leaves_shoulder_free(view, other, right) for other in near.tolist())
    offset, turned = offset_in_lane(view, row, lane)
    if network.lanes[right].kind is not LaneKind.SHOULDER or abs(turned) > aligned_within_rad(view, row):
        return False
    beyond = 0.5 * network.lanes[lane].width_m + offset - float(view.seen.half_width_m[row])
    return network.lanes[right].width_m + beyond >= view.world.config.pull_over.shoulder_free_m
