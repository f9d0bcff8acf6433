"""Return after a yield: the navigator leads the vehicle back to its lane before SUMO takes over."""

import math
from typing import Final

from siren_ros.base.numerics.changed import changed
from siren_ros.base.numerics.units import steps_from_s
from siren_ros.simulation.behaviour.civilians.junction_entry import may_cross, way_inside_m
from siren_ros.simulation.behaviour.civilians.rescue_lane import kept_offset_m
from siren_ros.simulation.behaviour.driving.civilian_unit import (
    YieldStep,
    YieldUnit,
    aligned_within_rad,
    lane_of,
    standing,
    yield_event,
)
from siren_ros.simulation.behaviour.driving.lane_change import offset_in_lane
from siren_ros.simulation.behaviour.driving.navigator import FULL_BRAKE, NavigatorState
from siren_ros.simulation.behaviour.driving.speed_mechanisms import navigate
from siren_ros.simulation.behaviour.driving.step_view import Ego
from siren_ros.simulation.behaviour.paths.tracked_path import blend_length_m, path_onto
from siren_ros.simulation.conflicts.yielding import Rank, rank_of
from siren_ros.simulation.roads.road_network import NO_LANE
from siren_ros.simulation.world.actors import Mode
from siren_ros.simulation.world.traffic_state import EventKind

_REJOIN_OFFSET_M: Final = 0.3
"""A vehicle within this distance of the lane's centre line is back in its lane."""
_REJOIN_LENGTHS: Final = 1.5
"""Least length of the return in vehicle lengths: a long vehicle that turns in sharply comes too near to others that
return next to it."""
_REJOIN_AHEAD_M: Final = 60.0
"""Length of the path of a returning vehicle."""
LEAST_SIDEWAYS_M: Final = 6.0
"""Least length of a lateral move in the lane."""


def start_rejoin(unit: YieldUnit, ego: Ego) -> YieldStep:
    """Give the vehicle back to SUMO if it is in its lane, otherwise give it a path to the lane's centre.

    Where a rescue lane is open, the vehicle keeps to the side.
    A driver who is over the stop line of a red light waits for green first.
    """
    if is_over_red_line(ego):
        unit = changed(unit, phase=Mode.REJOIN, navigator=NavigatorState(), stopped_steps=0)
        return YieldStep(unit, FULL_BRAKE if standing(ego) else navigate(unit, ego, 0.0, ego.world.hold_navigator)[1])
    lane = lane_of(unit, ego)
    if lane == NO_LANE or _straight(ego, lane, _REJOIN_OFFSET_M):
        return _hand_back(unit, ego)
    config, half_length, navigator_config = ego.civilian_driver, ego.half_length_m, ego.navigator_config
    reference = ego.line_along(lane, _REJOIN_AHEAD_M, 2.0, civilian=True, through_junctions=False)
    _, left = reference.curve.project_one(*ego.place)
    speed = 0.5 * (ego.speed_mps + config.yielding.rejoin_speed_mps)
    merge = blend_length_m(
        left,
        speed,
        config.pull_over.duration_s,
        LEAST_SIDEWAYS_M,
        navigator_config,
    )
    merge = max(merge, _REJOIN_LENGTHS * 2.0 * half_length)
    room = reference.curve.length_m - 2.0 - half_length - 1.0
    # So near to the stop line the vehicle cannot become straight at the lane's middle, so it keeps its offset.
    kept_m = kept_offset_m(ego, lane)
    offset = kept_m if merge + half_length <= room else left
    length, shorten = min(merge, max(room, 2.0)), half_length + 1.0
    path = path_onto(reference, ego.pose, length, navigator_config, offset_m=offset, shorten_m=shorten)
    navigator = NavigatorState().following(path, *ego.place)
    side = 1 if left < kept_m else -1
    return rejoin(changed(unit, phase=Mode.REJOIN, navigator=navigator, stopped_steps=0, side=side), ego)


def rejoin(unit: YieldUnit, ego: Ego) -> YieldStep:
    """One step of the return. SUMO takes over in the lane, at the path's end, or if the path stays blocked."""
    if unit.navigator.path is None:
        return start_rejoin(unit, ego)
    config = ego.civilian_driver.yielding
    stopped = unit.stopped_steps + 1 if standing(ego) else 0
    lane = lane_of(unit, ego)
    blocked = stopped >= steps_from_s(config.rejoin_blocked_s) and (lane == NO_LANE or _straight(ego, lane))
    if blocked or unit.navigator.done or lane == NO_LANE or _straight(ego, lane, _REJOIN_OFFSET_M):
        return _hand_back(unit, ego)
    navigator, command, _ = navigate(unit, ego, config.rejoin_speed_mps, ego.world.civilian_navigator)
    return YieldStep(changed(unit, navigator=navigator, stopped_steps=stopped), command)


def is_over_red_line(ego: Ego) -> bool:
    """Whether a vehicle is beyond the stop line of a red light without blocking others.

    SUMO would let it go on.
    """
    outlook = ego.seen.outlook
    if outlook is None:
        return False
    front = outlook.front_m(ego.row)
    entry = outlook.course(ego.row).entry_at(front)
    if entry is None or rank_of(entry.connection, outlook.signals) is not Rank.RED:
        return False
    return not may_cross(ego, entry.connection, front - entry.start_m + way_inside_m(ego, entry.connection, ego.lane))


def _straight(ego: Ego, lane: int, off_m: float = math.inf) -> bool:
    """Whether SUMO can take over without a jump, with at most ``off_m`` lateral distance to its place in the lane.

    SUMO's standing vehicles always point along their lanes.
    """
    offset, turned = offset_in_lane(ego, lane)
    return abs(offset - kept_offset_m(ego, lane)) <= off_m and abs(turned) <= aligned_within_rad(ego)


def _hand_back(unit: YieldUnit, ego: Ego) -> YieldStep:
    return YieldStep(None, None, (yield_event(unit, ego, EventKind.YIELD_RELEASED),))
