"""Forced lane changes of any controlled vehicle: is one feasible, its path, and whether it is finished."""

import math
from dataclasses import dataclass
from enum import StrEnum
from typing import Final

import numpy as np

from siren_ros.behaviour.config import LaneChangeConfig
from siren_ros.behaviour.driving.step_view import StepView
from siren_ros.behaviour.paths.lane_path import (
    LaneEnd,
    LanePath,
    lanes_along,
    nearest_on_lane,
    neighbour_lane,
    path_on_lanes,
)
from siren_ros.behaviour.paths.tracked_path import PEAK_CURVATURE, TrackedPath, blend_length_m, path_onto
from siren_ros.roads.movements import road_lane_of
from siren_ros.roads.road_network import NO_LANE, LaneKind
from siren_ros.world.actors import NO_ACTOR
from siren_ros.world.traffic_state import Indices

_GAP_RANGE_M: Final = 60.0
_EASED_OFF: Final = 0.75
"""Part of the present speed that is left on average, where the target speed is lower."""
_SPEED_UP_MPS: Final = 2.5
"""Gain of speed that a lane change is laid out for."""
_STEER_SHARE: Final = 0.7
"""Part of the steering range that a lane change may use."""


class Refusal(StrEnum):
    """Why a lateral request is not feasible at a step."""

    NO_LANE = "no_lane"
    JUNCTION = "junction"
    NO_ROOM = "no_room"
    ASTRAY = "leads_astray"
    BESIDE = "vehicle_beside"
    GAP_FRONT = "gap_front"
    GAP_REAR = "gap_rear"
    TURNING = "turning"
    """The vehicle is still turning onto its road."""


@dataclass(frozen=True)
class LaneChangeQuery:
    """Who wants to go where."""

    row: int
    lane: int
    """Present lane."""
    side: int
    """+1 left, −1 right."""
    target_mps: float
    """Speed that the vehicle will have during the change."""
    route: Indices
    civilian: bool
    ends_on_junction: bool = False
    """Whether the change may be finished on the next junction."""


@dataclass(frozen=True)
class LaneGaps:
    """Free way to the vehicles in a lane, from bumper to bumper; infinite where there is none."""

    front_m: float
    front_mps: float
    rear_m: float
    rear_mps: float
    front_id: int = NO_ACTOR
    """Vehicle ahead."""


def gaps_in_lane(view: StepView, row: int, lane: int) -> LaneGaps:
    """Gaps of a vehicle to those ahead and behind in any lane; negative while it is alongside one."""
    seen = view.seen
    found = view.world.network.lanes[lane]
    x, y, _ = view.pose(row)
    rows = seen.near(x, y, _GAP_RANGE_M, but=row)
    own_s, _, heading = nearest_on_lane(found.centre, x, y)
    s, left = found.centre.project(np.column_stack((seen.x_m[rows], seen.y_m[rows])))
    turned = seen.yaw_rad[rows] - heading
    cos, sin = np.abs(np.cos(turned)), np.abs(np.sin(turned))
    side = cos * seen.half_width_m[rows] + sin * seen.half_length_m[rows]
    inside = (np.abs(left) - side < float(seen.half_width_m[row]) + 0.1) & (cos > 0.5)
    rows, s = rows[inside], s[inside]
    if len(rows) == 0:
        return LaneGaps(math.inf, 0.0, math.inf, 0.0)
    gap = np.abs(s - own_s) - seen.half_length_m[rows] - float(seen.half_length_m[row])
    front = np.where(s >= own_s, gap, np.inf)
    rear = np.where(s < own_s, gap, np.inf)
    f, r = int(np.argmin(front)), int(np.argmin(rear))
    return LaneGaps(
        front_m=float(front[f]),
        front_mps=float(seen.speed_mps[rows[f]]),
        rear_m=float(rear[r]),
        rear_mps=float(seen.speed_mps[rows[r]]),
        front_id=int(seen.actor_id[rows[f]]) if math.isfinite(front[f]) else NO_ACTOR,
    )


def refusal_of_gaps(gaps: LaneGaps, speed_mps: float, target_mps: float, config: LaneChangeConfig) -> Refusal | None:
    """Why a gap cannot be entered, None where it can.

    The gaps must last for the whole manoeuvre. The vehicle slows to its target speed, if that is lower. The vehicle
    behind it brakes too, after a reaction time. Towards the vehicle ahead it brakes in the same way.

    Args:
        gaps: In the target lane.
        speed_mps: Of the vehicle that changes lanes.
        target_mps: Speed of the manoeuvre.
        config: Gaps, times and decelerations.
    """
    if min(gaps.front_m, gaps.rear_m) <= 0.0:
        return Refusal.BESIDE
    closing = max(speed_mps - gaps.front_mps, 0.0)
    if gaps.front_m < config.front_gap_m + closing * config.front_time_s + closing**2 / (2.0 * config.front_brake_mps2):
        return Refusal.GAP_FRONT
    slowest = min(speed_mps, target_mps)
    closing = max(gaps.rear_mps - slowest, 0.0)
    way = closing * config.rear_time_s + closing**2 / (2.0 * config.brake_mps2)
    way -= (speed_mps - slowest) ** 2 / (2.0 * config.own_brake_mps2)
    return Refusal.GAP_REAR if gaps.rear_m < config.rear_gap_m + max(way, 0.0) else None


def change_length_m(view: StepView, query: LaneChangeQuery) -> float:
    """Length of a lane change that starts now: a duration at the present speed, and what the vehicle can steer."""
    config, vehicle = config_of(view, query), view.vehicle(query.row)
    sharpest = math.tan(_STEER_SHARE * vehicle.max_steer_rad) / vehicle.wheelbase_m
    width = view.world.network.lanes[query.lane].width_m
    speed = float(view.seen.speed_mps[query.row])
    on_the_way = max(min(query.target_mps, speed + _SPEED_UP_MPS), _EASED_OFF * speed)
    steerable = blend_length_m(
        width, on_the_way, config.duration_s, config.length_min_m, view.navigator_config(query.row)
    )
    return max(config.length_min_m, math.sqrt(PEAK_CURVATURE * width / sharpest), config.duration_s * speed, steerable)


def config_of(view: StepView, query: LaneChangeQuery) -> LaneChangeConfig:
    """Parameters of the EMV's or of the civilians' lane changes."""
    config = view.world.config
    return config.civilian_lane_change if query.civilian else config.lane_change


def assess(view: StepView, query: LaneChangeQuery) -> Refusal | LanePath:
    """The reference line in the target lane of a lane change, or why it is not feasible now.

    A lane change does not start on a junction, and ends before the next one unless the query says otherwise. Civilians
    use driving lanes only. A lane that does not follow the route is accepted if enough of it is left to come back.
    """
    network, config = view.world.network, config_of(view, query)
    if road_lane_of(network, query.lane) == NO_LANE:
        return Refusal.JUNCTION
    target = neighbour_lane(network, query.lane, query.side)
    if target == NO_LANE or not _open_to(view, target, query.civilian):
        return Refusal.NO_LANE
    speed = float(view.seen.speed_mps[query.row])
    refusal = refusal_of_gaps(gaps_in_lane(view, query.row, target), speed, query.target_mps, config)
    if refusal is not None:
        return refusal
    length = change_length_m(view, query)
    x, y, _ = view.pose(query.row)
    position = nearest_on_lane(network.lanes[target].centre, x, y)[0]
    ahead = length + config.return_room_m + 30.0
    lanes, end = lanes_along(network, target, position, query.route, ahead, query.civilian, query.ends_on_junction)
    reference = path_on_lanes(network, lanes, end, position, ahead)
    room = reference.curve.length_m - float(view.seen.half_length_m[query.row])
    if room < length:
        return Refusal.NO_ROOM
    if reference.end is LaneEnd.ASTRAY and room < length + config.return_room_m:
        return Refusal.ASTRAY
    return reference


def _open_to(view: StepView, lane: int, civilian: bool) -> bool:
    road = road_lane_of(view.world.network, lane)
    if road == NO_LANE:
        return False
    found = view.world.network.lanes[road]
    if civilian:
        return found.civilian_allowed and found.kind is LaneKind.DRIVING
    return found.emergency_allowed


def lane_change_path(view: StepView, query: LaneChangeQuery, reference: LanePath, stop_at_end: bool) -> TrackedPath:
    """``BuildLaneChangeWaypoints``: from the present pose into the target lane and along it."""
    shorten = float(view.seen.half_length_m[query.row]) + 1.0 if stop_at_end else 0.0
    length = change_length_m(view, query)
    return path_onto(
        reference,
        view.pose(query.row),
        length,
        view.navigator_config(query.row),
        stop_at_end=stop_at_end,
        shorten_m=shorten,
    )


def entered_lane(view: StepView, row: int, lane: int) -> bool:
    """Whether a vehicle's whole footprint lies in a lane and its heading is the lane's (``HeadingAligned``)."""
    offset, turned = offset_in_lane(view, row, lane)
    if abs(turned) > view.world.constants.heading_aligned_rad:
        return False
    seen, found = view.seen, view.world.network.lanes[lane]
    side = seen.half_width_m[row] * math.cos(turned) + seen.half_length_m[row] * abs(math.sin(turned))
    room = max(0.5 * found.width_m - float(side), 0.1) + view.world.config.lane_change.entered_tolerance_m
    return abs(offset) <= room


def offset_in_lane(view: StepView, row: int, lane: int) -> tuple[float, float]:
    """Offset of a vehicle's centre from a lane's centre line (left positive) and its heading relative to the lane."""
    x, y, yaw = view.pose(row)
    centre = view.world.network.lanes[lane].centre
    _, left, heading = nearest_on_lane(centre, x, y)
    return left, math.remainder(yaw - heading, 2.0 * math.pi)
