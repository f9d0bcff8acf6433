"""Guard 3 of the EMV: forced lane changes, by SUMO's lateral intent and for the route."""

import math
from typing import Final

import numpy as np

from siren_ros.base.numerics.changed import changed
from siren_ros.base.numerics.units import steps_from_s
from siren_ros.simulation.behaviour.driving.collision_watch import DRIFT_SINE, MOVING_MPS
from siren_ros.simulation.behaviour.driving.emv_unit import (
    PATH_AHEAD_M,
    ROUTE,
    EmvUnit,
    GuardResult,
    LateralRequest,
    advice_of,
    event_of,
    plan_route,
    present_lane,
    strategic_side,
)
from siren_ros.simulation.behaviour.driving.lane_change import (
    LaneChangeQuery,
    Refusal,
    assess,
    entered_lane,
    gaps_in_lane,
)
from siren_ros.simulation.behaviour.driving.step_view import Ego
from siren_ros.simulation.behaviour.paths.lane_path import LaneEnd, LanePath, neighbour_lane
from siren_ros.simulation.roads.road_network import NO_LANE, LaneKind
from siren_ros.simulation.world.traffic_state import EventKind

SUMO: Final = "sumo"
_REASONS: Final = {LaneKind.SHOULDER: "shoulder", LaneKind.DRIVING: "free_lane"}
"""Names of requests by the kind of lane that the EMV uses to pass slow traffic."""


_STRATEGIC_DISTANCE_M: Final = 200.0
"""Distance before the end of a lane that does not follow the route at which the EMV wants to leave it."""
_STRATEGIC_S: Final = 10.0
"""The same as a time, which is the larger distance above 72 km/h."""


def lateral_intent(unit: EmvUnit, ego: Ego) -> tuple[int, str]:
    """Side to which the EMV wants to go (+1 left, −1 right, 0 none) and why: first the route, then slow traffic.

    It wants no lane change before its first plan, and none to the side to which the vehicle ahead makes way for it.
    """
    if unit.plan is None:
        return 0, SUMO
    near = unit.navigator.remaining_m < max(_STRATEGIC_DISTANCE_M, _STRATEGIC_S * ego.speed_mps)
    if unit.plan.end is LaneEnd.ASTRAY and near:
        return strategic_side(ego.network, present_lane(ego, unit.navigator), ego.route), ROUTE
    side, reason = free_side(unit, ego)
    if side == 0:
        advice = advice_of(ego, unit.actor_id)
        side, reason = (advice.lane_change_intent if advice is not None else 0), SUMO
    return (0, SUMO) if side != 0 and _leader_makes_way(unit, ego, side) else (side, reason)


def _leader_makes_way(unit: EmvUnit, ego: Ego, side: int) -> bool:
    """Whether the next vehicle on the EMV's path moves to that side, where it would be ahead of the EMV again."""
    path, seen = unit.navigator.path, ego.seen
    rows = ego.near(ego.emv_driver.pass_from_m)
    if path is None or len(rows) == 0:
        return False
    s_m, left_m, nearest = path.curve.project(seen.x_m[rows], seen.y_m[rows])
    on_path = (s_m > unit.navigator.progress_m) & (np.abs(left_m) < ego.half_width_m + seen.half_width_m[rows])
    if not on_path.any():
        return False
    leader = np.argmin(np.where(on_path, s_m, np.inf))
    moving = seen.speed_mps[rows[leader]] > MOVING_MPS
    off_rad = float(seen.yaw_rad[rows[leader]] - path.curve.heading_rad[nearest[leader]])
    return bool(moving) and side * math.sin(off_rad) > DRIFT_SINE


def free_side(unit: EmvUnit, ego: Ego) -> tuple[int, str]:
    """Side of a free lane or shoulder if slow traffic ahead delays the EMV, and its name; 0 if there is none.

    A lane that does not lead on along the route is of use only where it leads past the slow traffic and some way on. At
    a stop line at which it ends, the EMV would stand next to the first vehicle of the queue.
    """
    network, config = ego.network, ego.emv_driver
    lane = present_lane(ego, unit.navigator)
    if lane == NO_LANE or network.lanes[lane].kind is not LaneKind.DRIVING:
        return 0, ""
    gaps = gaps_in_lane(ego, lane)
    if gaps.front_m > config.pass_from_m or gaps.front_mps > config.slow_below_mps:
        return 0, ""
    for side in (-1, 1):
        beside = neighbour_lane(network, lane, side)
        reason = _REASONS.get(network.lanes[beside].kind) if beside != NO_LANE else None
        if reason is not None and _leads_past(ego, lane, beside, side, gaps.front_m + config.pass_gain_m):
            return side, reason
    return 0, ""


def _leads_past(ego: Ego, lane: int, beside: int, side: int, free_m: float) -> bool:
    """Whether a lane is free for a distance, and long enough to pass the slow traffic and return."""
    network, config, seen = ego.network, ego.emv_driver, ego.seen
    reference = ego.line_along(beside, PATH_AHEAD_M)
    others = ego.near(PATH_AHEAD_M)
    s_m, left_m, _ = reference.curve.project(seen.x_m[others], seen.y_m[others])
    half_m = seen.half_length_m[others]
    apart_m, edge_m = -side * left_m, 0.5 * network.lanes[beside].width_m
    inside = (np.abs(left_m) < edge_m) & (s_m + half_m > 0.0)
    if float(np.min((s_m - half_m)[inside], initial=np.inf)) - seen.half_length_m[ego.row] <= free_m:
        return False
    slow = (seen.speed_mps[others] <= config.slow_below_mps) & (s_m > 0.0)
    slow &= (apart_m > edge_m) & (apart_m < edge_m + network.lanes[lane].width_m)
    head_m = float(np.max((s_m + half_m)[slow], initial=0.0))
    return reference.end is not LaneEnd.ASTRAY or reference.curve.length_m - head_m >= config.pass_return_m


def forced_lane_change(unit: EmvUnit, ego: Ego) -> GuardResult:
    """Start the requested lane change if it is feasible, otherwise defer it.

    The cooldown is the least time between the starts of two forced lane changes. A deferred request is reconsidered at
    every step.
    """
    if unit.between:
        return _drop_request(unit, ego, "corridor" if unit.corridor else "gap_escape")
    if unit.lane_change_forced:
        return unit, ()
    unit, events = _note_intent(unit, ego)
    request = unit.request
    cooled = ego.step - unit.change_step >= ego.world.cooldown_steps
    if request.side == 0 or request.seen_step != ego.step or not cooled:
        return unit, events
    query = LaneChangeQuery(
        ego,
        lane=present_lane(ego, unit.navigator),
        side=request.side,
        target_mps=ego.world.speeds.emv_lane_change_mps,
        civilian=False,
        # Otherwise the EMV would stand forever at the end of a short lane that does not follow the route.
        ends_on_junction=request.reason == ROUTE,
    )
    verdict = assess(query)
    if isinstance(verdict, LanePath) and _is_turning(unit, ego, verdict):
        verdict = Refusal.TURNING
    if isinstance(verdict, Refusal):
        if request.deferred is None:
            events += (event_of(ego, EventKind.LANE_CHANGE_DEFERRED, side=request.side, reason=verdict.value),)
        return changed(unit, request=changed(request, deferred=verdict)), events
    plan, navigator = plan_route(ego, query.target, unit.navigator, merge_m=query.length_m)
    started = event_of(ego, EventKind.LANE_CHANGE_STARTED, side=request.side, reason=request.reason, lane=query.target)
    unit = changed(unit, plan=plan, navigator=navigator, request=LateralRequest())
    return changed(unit, change_side=request.side, change_step=ego.step), (*events, started)


def complete_lane_change(unit: EmvUnit, ego: Ego) -> GuardResult:
    """``RestoreLaneChange``: when the footprint is in the target lane, or the path is completed."""
    if not unit.lane_change_forced:
        return unit, ()
    lane = present_lane(ego, unit.navigator)
    if not unit.navigator.done and (lane == NO_LANE or not entered_lane(ego, lane)):
        return unit, ()
    done = event_of(ego, EventKind.LANE_CHANGE_COMPLETED, side=unit.change_side, lane=lane)
    return changed(unit, change_side=0), (done,)


def cancel_lane_change(unit: EmvUnit, ego: Ego, reason: str) -> GuardResult:
    """``RestoreLaneChange`` before the end: the next waypoints replace the path."""
    if not unit.lane_change_forced:
        return unit, ()
    cancelled = event_of(ego, EventKind.LANE_CHANGE_CANCELLED, side=unit.change_side, reason=reason)
    return changed(unit, change_side=0, plan=None), (cancelled,)


_BEND_MAX_1PM: Final = 0.02
"""Curvature difference between path and target lane above which the EMV still turns onto the road."""


def _is_turning(unit: EmvUnit, ego: Ego, reference: LanePath) -> bool:
    """Whether the EMV follows a bend that the target lane does not have: its wheels are not where a change begins."""
    path = unit.navigator.path
    if path is None:
        return False
    bend = reference.curve.place(reference.curve.project_one(*ego.place)[0])[3]
    return abs(path.curve.place(unit.navigator.progress_m)[3] - bend) > _BEND_MAX_1PM


_INTENT_PAUSE_S: Final = 1.0
"""SUMO's intent varies from step to step; a request ends after a pause of this length."""


def _note_intent(unit: EmvUnit, ego: Ego) -> GuardResult:
    side, reason = lateral_intent(unit, ego)
    request = unit.request
    if side == 0:
        if request.side == 0 or ego.step - request.seen_step < steps_from_s(_INTENT_PAUSE_S):
            return unit, ()
        return _drop_request(unit, ego, "intent_gone")
    if side == request.side:
        return changed(unit, request=changed(request, reason=reason, seen_step=ego.step)), ()
    unit, events = _drop_request(unit, ego, "intent_changed")
    asked = event_of(ego, EventKind.LANE_CHANGE_REQUESTED, side=side, reason=reason)
    return changed(unit, request=LateralRequest(side, reason, ego.step)), (*events, asked)


def _drop_request(unit: EmvUnit, ego: Ego, reason: str) -> GuardResult:
    if unit.request.side == 0:
        return unit, ()
    dropped = event_of(ego, EventKind.LANE_CHANGE_CANCELLED, side=unit.request.side, reason=reason)
    return changed(unit, request=LateralRequest()), (dropped,)
