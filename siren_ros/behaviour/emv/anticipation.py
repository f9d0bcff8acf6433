"""Anticipation: the EMV adapts early to the vehicles ahead in its way, before its collision handling has to brake."""

import math
from typing import Final

import numpy as np

from siren_ros.behaviour.config import AnticipationConfig
from siren_ros.behaviour.driving.free_space import SpeedLimit
from siren_ros.behaviour.driving.lane_change import gaps_in_lane
from siren_ros.behaviour.driving.situation import StepView
from siren_ros.behaviour.emv.forced_lane_change import ROUTE
from siren_ros.behaviour.emv.route import present_lane
from siren_ros.behaviour.emv.unit import EmvUnit
from siren_ros.behaviour.paths.lane_path import neighbour_lane
from siren_ros.numerics.arrays import Floats
from siren_ros.roads.road_network import NO_LANE

UNLIMITED: Final = SpeedLimit()
_ALONG: Final = 0.7
"""Cosine above which a vehicle counts as one of the EMV's own direction."""


def anticipated_limit(unit: EmvUnit, view: StepView, row: int) -> SpeedLimit:
    """How fast the EMV drives towards the vehicles ahead on its path, with gentle braking and in good time.

    In the corridor and during a gap escape the passage limit stands in its place.
    """
    path, config = unit.navigator.path, view.world.config.anticipation
    if path is None:
        return UNLIMITED
    seen = view.seen
    x, y, _ = view.pose(row)
    rows = seen.near(x, y, view.world.constants.leader_query_m, but=row)
    if len(rows) == 0:
        return UNLIMITED
    s, left, nearest = path.curve.project(seen.x_m[rows], seen.y_m[rows])
    turned = seen.yaw_rad[rows] - path.curve.heading_rad[nearest]
    cos, sin = np.cos(turned), np.sin(turned)
    half_length, half_width = seen.half_length_m[rows], seen.half_width_m[rows]
    reach = np.abs(cos) * half_length + np.abs(sin) * half_width
    gap = s - reach - unit.navigator.progress_m - float(seen.half_length_m[row])
    inside = np.abs(sin) * half_length + np.abs(cos) * half_width + float(seen.half_width_m[row]) + config.side_margin_m
    overlap = inside - np.abs(left)
    ahead = (cos > _ALONG) & (overlap > 0.0) & (gap > 0.0) & (s < path.length_m)
    leaving = (seen.speed_mps[rows] * sin * np.sign(left))[ahead]
    allowed = approach_speed_mps(gap[ahead], (seen.speed_mps[rows] * cos)[ahead], overlap[ahead], leaving, config)
    least = min(float(allowed.min(initial=np.inf)), _needed_lane_mps(unit, view, row))
    easing = float(seen.speed_mps[row]) - config.ease_off_mps2 / view.world.config.emv.navigator.speed_gain_1ps
    return SpeedLimit(max(least, easing))


def _needed_lane_mps(unit: EmvUnit, view: StepView, row: int) -> float:
    """Speed towards the vehicle ahead in the lane that the route needs, while the change to it is not yet feasible."""
    request = unit.request
    if request.side == 0 or request.reason != ROUTE:
        return math.inf
    target = neighbour_lane(view.world.network, present_lane(view, row, unit.navigator), request.side)
    if target == NO_LANE:
        return math.inf
    gaps = gaps_in_lane(view, row, target)
    if not 0.0 < gaps.front_m < math.inf:
        return math.inf
    one = np.ones(1)
    config = view.world.config.anticipation
    return float(approach_speed_mps(gaps.front_m * one, gaps.front_mps * one, one, 0.0 * one, config)[0])


def approach_speed_mps(
    gap_m: Floats, lead_mps: Floats, overlap_m: Floats, leaving_mps: Floats, config: AnticipationConfig
) -> Floats:
    """Speed towards each vehicle ahead.

    The speed is Krauss's safe speed (1998), ``−bτ + sqrt((bτ)² + v_l² + 2b·gap)``, with a gentle deceleration b. A
    vehicle that leaves the path sideways may be approached faster: with the mean speed that brings the EMV to the
    standstill gap behind it at the moment at which it has left.

    Args:
        gap_m: From bumper to bumper.
        lead_mps: Speed of the vehicle ahead along the path.
        overlap_m: Lateral distance by which it still overlaps the way of the EMV.
        leaving_mps: Its lateral speed away from the path.
        config: Deceleration, time gap, standstill gap.
    """
    brake, headway = config.brake_mps2, config.headway_s
    free = np.maximum(gap_m - config.standstill_gap_m, 0.0)
    safe = np.sqrt((brake * headway) ** 2 + lead_mps**2 + 2.0 * brake * free) - brake * headway
    time_s = np.maximum(overlap_m / config.leaving_mps, config.headway_s)
    cleared = np.where(leaving_mps > config.leaving_min_mps, lead_mps + free / time_s, 0.0)
    return np.maximum(safe, cleared)
