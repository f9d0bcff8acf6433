"""Rescue lane: which civilians keep it open, and at which offset in their lane.

SUMO drives them to the side and back (``siren_ros/simulation/traffic/sumo/rescue_lane.py``), whether an EMV comes or
not. They have made way before they hear it, so that they go on as before.
"""

from typing import Final

from siren_ros.simulation.behaviour.driving.civilian_unit import aligned_within_rad
from siren_ros.simulation.behaviour.driving.lane_change import offset_in_lane
from siren_ros.simulation.behaviour.driving.step_view import Ego
from siren_ros.simulation.roads.road_network import NO_LANE


def rescue_side(ego: Ego, lane: int) -> int:
    """Side to which drivers of a lane keep in slow traffic: +1 left, −1 right, 0 if none has to."""
    world = ego.world
    return int(world.rescue_sides[lane]) if world.duty and lane != NO_LANE else 0


def kept_offset_m(ego: Ego, lane: int) -> float:
    """Offset from the lane's centre line of a slow vehicle that keeps to the side; 0 if it keeps to the middle."""
    config = ego.civilian_driver.pull_over
    if ego.speed_mps >= config.flows_mps:
        return 0.0
    room_m = 0.5 * ego.network.lanes[lane].width_m - ego.half_width_m - config.mirror_m
    return rescue_side(ego, lane) * max(room_m, 0.0)


_KEPT_WITHIN_M: Final = 0.25
"""A driver within this distance of the place at the edge has already made way."""


def needs_no_siren(ego: Ego) -> bool:
    """Whether a driver on a road with a rescue lane need not respond to an EMV: it keeps to the side, or traffic flows.

    In flowing traffic nobody stops on such a road.
    """
    lane, config = ego.lane, ego.civilian_driver.pull_over
    side = rescue_side(ego, lane)
    if side == 0 or ego.speed_mps >= config.flows_mps:
        return side != 0
    offset, turned = offset_in_lane(ego, lane)
    short_m = side * (kept_offset_m(ego, lane) - offset)
    return short_m <= _KEPT_WITHIN_M and abs(turned) <= aligned_within_rad(ego)
