"""How fast the EMV may go: between other vehicles, towards the vehicles ahead, and onto a junction on red.

* Passage: how near the EMV's footprint comes to the vehicles beside it decides the speed.
* Anticipation: the EMV adapts early to the vehicles ahead, before its collision handling has to brake.
* Junction entry: the siren asks for the right of way and does not give it, so the EMV enters on red slowly enough
  to stop.
"""

import math
from typing import Final

import numpy as np

from siren_ros.behaviour.config import AnticipationConfig
from siren_ros.behaviour.driving.emv_unit import ROUTE, EmvUnit, present_lane
from siren_ros.behaviour.driving.free_space import FreeWay, Obstacles, SpeedLimit
from siren_ros.behaviour.driving.lane_change import gaps_in_lane
from siren_ros.behaviour.driving.navigator import free_way_of
from siren_ros.behaviour.driving.step_view import Ego
from siren_ros.behaviour.paths.lane_path import neighbour_lane
from siren_ros.conflicts.yielding import Rank, rank_of
from siren_ros.numerics.arrays import Flags, Floats, Rows
from siren_ros.numerics.braking import braking_distance_m, safe_following_mps, speed_before_mps
from siren_ros.roads.road_network import NO_LANE

UNLIMITED: Final = SpeedLimit()


def rows_around(ego: Ego) -> tuple[Rows, Flags]:
    """Rows of the vehicles around the EMV, and which of them point in its direction."""
    rows = ego.near(ego.config.gap_escape.horizon_m + ego.config.gap_escape.beside_m)
    return rows, np.cos(ego.seen.yaw_rad[rows] - ego.pose[2]) > ego.config.gap_escape.along_cosine


def free_way(unit: EmvUnit, ego: Ego) -> FreeWay | None:
    """How near the EMV's footprint comes to others along its path; None without a path.

    In the corridor, vehicles ahead are expected to keep moving. During a gap escape they may stop at once.
    """
    navigator, config = unit.navigator, ego.config.gap_escape
    if navigator.path is None:
        return None
    rows, along = rows_around(ego)
    speed = ego.seen.speed_mps[rows]
    counts = along | (speed < config.crossing_mps) | unit.gap_escape_active
    rows, along, speed = rows[counts], along[counts], speed[counts]
    time_s = np.where(along, 0.0, config.watch_s)
    credit = np.where(along & (not unit.gap_escape_active), braking_distance_m(speed**2, config.leader_brake_mps2), 0.0)
    return free_way_of(navigator, ego, config.horizon_m, Obstacles.swept(ego.seen, rows, time_s), credit)


def passage_limit(unit: EmvUnit, ego: Ego) -> SpeedLimit:
    """How fast the EMV may go between others in the corridor and during a gap escape.

    The collision handling would keep too much distance from vehicles that the EMV squeezes past, or is off. This limit
    follows from the footprint itself along the path.
    """
    if not unit.between:
        return UNLIMITED
    way, config = free_way(unit, ego), ego.config
    if way is None:
        return UNLIMITED
    speed, brake = ego.speed_mps, config.gap_escape.brake_mps2
    if unit.gap_escape_active:
        escape = config.gap_escape
        return way.limit(speed, escape.squeezes, escape.stop_short_m, brake, escape.touch_m)
    corridor = config.corridor
    return way.limit(speed, corridor.squeezes, corridor.stop_short_m, brake, corridor.clearance_m)


def anticipated_limit(unit: EmvUnit, ego: Ego) -> SpeedLimit:
    """How fast the EMV drives towards the vehicles ahead on its path, with gentle braking and in good time.

    In the corridor and during a gap escape the passage limit stands in its place.
    """
    path, config = unit.navigator.path, ego.config.anticipation
    if path is None:
        return UNLIMITED
    seen = ego.seen
    rows = ego.near(ego.world.constants.leader_query_m)
    if len(rows) == 0:
        return UNLIMITED
    s, left, nearest = path.curve.project(seen.x_m[rows], seen.y_m[rows])
    turned = seen.yaw_rad[rows] - path.curve.heading_rad[nearest]
    cos, sin = np.cos(turned), np.sin(turned)
    half_length, half_width = seen.half_length_m[rows], seen.half_width_m[rows]
    reach = np.abs(cos) * half_length + np.abs(sin) * half_width
    gap = s - reach - unit.navigator.progress_m - ego.half_length_m
    inside = np.abs(sin) * half_length + np.abs(cos) * half_width + ego.half_width_m + config.side_margin_m
    overlap = inside - np.abs(left)
    ahead = (cos > config.along_cosine) & (overlap > 0.0) & (gap > 0.0) & (s < path.length_m)
    leaving = (seen.speed_mps[rows] * sin * np.sign(left))[ahead]
    allowed = approach_speed_mps(gap[ahead], (seen.speed_mps[rows] * cos)[ahead], overlap[ahead], leaving, config)
    least = min(float(allowed.min(initial=np.inf)), _needed_lane_mps(unit, ego))
    easing = ego.speed_mps - config.ease_off_mps2 / ego.config.emv.navigator.speed_gain_1ps
    return SpeedLimit(max(least, easing))


def _needed_lane_mps(unit: EmvUnit, ego: Ego) -> float:
    """Speed towards the vehicle ahead in the lane that the route needs, while the change to it is not yet feasible."""
    request = unit.request
    if request.side == 0 or request.reason != ROUTE:
        return math.inf
    target = neighbour_lane(ego.network, present_lane(ego, unit.navigator), request.side)
    if target == NO_LANE:
        return math.inf
    gaps = gaps_in_lane(ego, target)
    if not 0.0 < gaps.front_m < math.inf:
        return math.inf
    one = np.ones(1)
    config = ego.config.anticipation
    return float(approach_speed_mps(gaps.front_m * one, gaps.front_mps * one, one, 0.0 * one, config)[0])


def approach_speed_mps(
    gap_m: Floats, lead_mps: Floats, overlap_m: Floats, leaving_mps: Floats, config: AnticipationConfig
) -> Floats:
    """Speed towards each vehicle ahead.

    The speed is Krauss's safe speed with a gentle deceleration. A vehicle that leaves the path sideways may be
    approached faster: with the mean speed that brings the EMV to the standstill gap behind it at the moment at which
    it has left.

    Args:
        gap_m: From bumper to bumper.
        lead_mps: Speed of the vehicle ahead along the path.
        overlap_m: Lateral distance by which it still overlaps the way of the EMV.
        leaving_mps: Its lateral speed away from the path.
        config: Deceleration, time gap, standstill gap.
    """
    free = np.maximum(gap_m - config.standstill_gap_m, 0.0)
    safe = safe_following_mps(lead_mps, free, config.brake_mps2, config.headway_s)
    time_s = np.maximum(overlap_m / config.leaving_mps, config.headway_s)
    cleared = np.where(leaving_mps > config.leaving_min_mps, lead_mps + free / time_s, 0.0)
    return np.maximum(safe, cleared)


def entry_limit(ego: Ego) -> SpeedLimit:
    """Speed towards the red lights ahead; no limit where there is none.

    Crossing traffic has green there and does not slow down. At a stop sign it starts from the line or is seen to come,
    and the collision handling is enough, as inside the junction.

    The EMV comes to the entry speed by gentle braking in good time. Where the light turns red late it slows down as
    far as gentle braking gets it.
    """
    outlook, config = ego.seen.outlook, ego.world.junction_entry
    if outlook is None:
        return UNLIMITED
    front = outlook.front_m(ego.row)
    limit = math.inf
    for entry in outlook.course(ego.row).entries:
        ahead = entry.start_m - front
        if ahead > 0.0 and rank_of(entry.connection, outlook.signals) is Rank.RED:
            limit = min(limit, speed_before_mps(config.speed_mps**2, config.brake_mps2, ahead))
    easing = ego.speed_mps - config.ease_off_mps2 / ego.config.emv.navigator.speed_gain_1ps
    return SpeedLimit(max(limit, easing))
