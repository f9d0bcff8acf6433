"""Forced lane changes of vehicles that SUMO does not drive: feasibility, path, and end.

Civilians change lanes to make way (``civilians.yield_lane_change``). The second half is guard 3 of the EMV (paper,
Algorithm 1), which asks for lane changes by SUMO's lateral intent, past slow traffic and for the route.
"""

import math
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from siren_ros.base.numerics.arrays import Floats, Points, Rows, changed
from siren_ros.base.numerics.braking import braking_distance_m
from siren_ros.base.numerics.compiled import YAW, X, Y, compiled
from siren_ros.base.numerics.geometry import project_on
from siren_ros.base.numerics.units import steps_from_s
from siren_ros.simulation.behaviour.driving.collision_watch import DRIFT_SINE, MOVING_MPS
from siren_ros.simulation.behaviour.driving.driver_states import (
    PATH_AHEAD_M,
    ROUTE,
    EmvUnit,
    GuardResult,
    LateralRequest,
    Refusal,
    advice_of,
    event_of,
    plan_route,
    present_lane,
    strategic_side,
)
from siren_ros.simulation.behaviour.driving.lane_path import nearest_on_line, neighbour_lane
from siren_ros.simulation.behaviour.driving.step_view import SEEN_HALF_LENGTH, SEEN_HALF_WIDTH, Ego
from siren_ros.simulation.behaviour.driving.tracked_path import (
    PEAK_CURVATURE,
    LaneEnd,
    LanePath,
    TrackedPath,
    blend_length_m,
    path_onto,
)
from siren_ros.simulation.roads.road_network import NO_LANE, LaneKind
from siren_ros.simulation.roads.routing import road_lane_of
from siren_ros.simulation.scenario.driver_parameters import LaneChangeConfig
from siren_ros.simulation.world.actors import NO_ACTOR, EventKind

_EASED_OFF: Final = 0.75
"""Mean share of the present speed during a change, if the target speed is lower."""
_SPEED_UP_MPS: Final = 2.5
"""Gain of speed for which the length of a lane change is planned."""
_STEER_SHARE: Final = 0.7
"""Share of the steering range that a lane change may use."""


@dataclass(frozen=True, eq=False)
class LaneChangeQuery:
    """A possible lane change of a vehicle."""

    ego: Ego
    lane: int
    """Present lane."""
    side: int
    """+1 left, −1 right."""
    target_mps: float
    """Speed of the vehicle during the change."""
    civilian: bool
    to_route: bool = False
    """Whether the lane is nearer to the route: the change may then end on the next junction, and be one of several."""

    @property
    def config(self) -> LaneChangeConfig:
        """Parameters of lane changes, for EMVs or civilians."""
        return self.ego.civilian_driver.lane_change if self.civilian else self.ego.emv_driver.lane_change

    @property
    def target(self) -> int:
        """The lane to change to; ``NO_LANE`` without one."""
        return neighbour_lane(self.ego.network, self.lane, self.side)

    @property
    def length_m(self) -> float:
        """Length of a lane change that starts now, from its duration at the present speed and the steering's limits."""
        config, ego = self.config, self.ego
        sharpest = math.tan(_STEER_SHARE * ego.vehicle.max_steer_rad) / ego.vehicle.wheelbase_m
        width, speed = ego.network.lanes[self.lane].width_m, ego.speed_mps
        on_the_way = max(min(self.target_mps, speed + _SPEED_UP_MPS), _EASED_OFF * speed)
        limits = config.duration_s, config.length_min_m
        steerable = blend_length_m(width, on_the_way, *limits, ego.navigator_config)
        sharp = math.sqrt(PEAK_CURVATURE * width / sharpest)
        return max(config.length_min_m, sharp, config.duration_s * speed, steerable)


class LaneGaps(NamedTuple):
    """Free distances to the vehicles in a lane, bumper to bumper; infinite if there is none."""

    front_m: float
    front_mps: float
    rear_m: float
    rear_mps: float
    front_id: int = NO_ACTOR
    """Id of the vehicle ahead."""
    rear_id: int = NO_ACTOR
    """Id of the vehicle behind."""


_GAP_RANGE_M: Final = 60.0
"""Vehicles in a lane are considered within this distance."""


def gaps_in_lane(ego: Ego, lane: int) -> LaneGaps:
    """Gaps of a vehicle to those ahead and behind in any lane; negative next to one."""
    centre, seen = ego.network.lanes[lane].centre, ego.seen
    front, rear, *gaps = _gaps(centre.points, centre.arc_m, seen.bodies, ego.row, _GAP_RANGE_M)
    if front < 0:
        return LaneGaps(math.inf, 0.0, math.inf, 0.0)
    ids = [
        int(seen.actor_id[row]) if gap_m < math.inf else NO_ACTOR
        for row, gap_m in zip((front, rear), gaps, strict=True)
    ]
    return LaneGaps(gaps[0], float(seen.speed_mps[front]), gaps[1], float(seen.speed_mps[rear]), *ids)


@compiled
def _gaps(points: Points, arc_m: Floats, bodies: Floats, row: int, range_m: float) -> tuple[int, int, float, float]:
    """Rows of the vehicles ahead and behind in a lane (−1 if there is none), and the gaps."""
    x_m, y_m = bodies[X, row], bodies[Y, row]
    half_length_m, half_width_m = bodies[SEEN_HALF_LENGTH, row], bodies[SEEN_HALF_WIDTH, row]
    own_s_m, _, heading = nearest_on_line(points, arc_m, x_m, y_m)
    front, rear, front_m, rear_m = -1, -1, np.inf, np.inf
    for other in range(bodies.shape[1]):
        dx, dy = bodies[X, other] - x_m, bodies[Y, other] - y_m
        if other == row or dx * dx + dy * dy >= range_m * range_m:
            continue
        turned = bodies[YAW, other] - heading
        cos, sin = abs(np.cos(turned)), abs(np.sin(turned))
        s_m, left_m = project_on(points, arc_m, bodies[X, other], bodies[Y, other])
        side = cos * bodies[SEEN_HALF_WIDTH, other] + sin * bodies[SEEN_HALF_LENGTH, other]
        if abs(left_m) - side >= half_width_m + 0.1 or cos <= 0.5:
            continue
        if front < 0:
            front = rear = other
        gap = abs(s_m - own_s_m) - bodies[SEEN_HALF_LENGTH, other] - half_length_m
        if s_m >= own_s_m and gap < front_m:
            front, front_m = other, gap
        if s_m < own_s_m and gap < rear_m:
            rear, rear_m = other, gap
    return front, rear, front_m, rear_m


def refusal_of_gaps(gaps: LaneGaps, speed_mps: float, target_mps: float, config: LaneChangeConfig) -> Refusal | None:
    """Reason why a gap cannot be entered; None if it can.

    The gaps must last for the whole manoeuvre. The vehicle slows to its target speed, if that is lower. The vehicle
    behind it brakes too, after a reaction time. Towards the vehicle ahead it brakes in the same way.
    """
    if min(gaps.front_m, gaps.rear_m) <= 0.0:
        return Refusal.BESIDE
    closing = max(speed_mps - gaps.front_mps, 0.0)
    way = closing * config.front_time_s + braking_distance_m(closing**2, config.front_brake_mps2)
    if gaps.front_m < config.front_gap_m + way:
        return Refusal.GAP_FRONT
    slowest = min(speed_mps, target_mps)
    closing = max(gaps.rear_mps - slowest, 0.0)
    way = closing * config.rear_time_s + braking_distance_m(closing**2, config.brake_mps2)
    way -= braking_distance_m((speed_mps - slowest) ** 2, config.own_brake_mps2)
    return Refusal.GAP_REAR if gaps.rear_m < config.rear_gap_m + max(way, 0.0) else None


_RETURN_ROOM_M: Final = 60.0
"""Length of lane needed after the change, if the target lane does not follow the route."""


def assess(query: LaneChangeQuery) -> Refusal | LanePath:
    """Reference line in the target lane of a lane change, or the reason why it is not feasible now.

    A lane change does not start on a junction, and ends before the next one unless the query says otherwise. Civilians
    use driving lanes only. A lane that does not follow the route is accepted if enough of it is left to come back.
    """
    ego, config, target = query.ego, query.config, query.target
    if road_lane_of(ego.network, query.lane) == NO_LANE:
        return Refusal.JUNCTION
    road = road_lane_of(ego.network, target)
    lane = None if road == NO_LANE else ego.network.lanes[road]
    driving = lane is not None and lane.civilian_allowed and lane.kind is LaneKind.DRIVING
    if lane is None or not (driving if query.civilian else lane.emergency_allowed):
        return Refusal.NO_LANE
    if refusal := refusal_of_gaps(gaps_in_lane(ego, target), ego.speed_mps, query.target_mps, config):
        return refusal
    ahead = query.length_m + _RETURN_ROOM_M + 30.0
    reference = ego.line_along(target, ahead, civilian=query.civilian, through_junctions=query.to_route)
    room = reference.curve.length_m - ego.half_length_m
    if room < query.length_m:
        return Refusal.NO_ROOM
    if reference.end is LaneEnd.ASTRAY and not query.to_route and room < query.length_m + _RETURN_ROOM_M:
        return Refusal.ASTRAY
    return reference


def lane_change_path(query: LaneChangeQuery, reference: LanePath, stop_at_end: bool) -> TrackedPath:
    """``BuildLaneChangeWaypoints``: path from the present pose into the target lane and along it."""
    ego, shorten_m = query.ego, query.ego.half_length_m + 1.0 if stop_at_end else 0.0
    return path_onto(reference, ego.pose, query.length_m, ego.navigator_config, 0.0, stop_at_end, shorten_m)


_ENTERED_TOLERANCE_M: Final = 0.15
"""Amount by which the footprint may reach over the lane's edge and still count as inside."""


def entered_lane(ego: Ego, lane: int) -> bool:
    """Whether a vehicle's whole footprint is in a lane with the lane's heading (``HeadingAligned``)."""
    offset, turned = offset_in_lane(ego, lane)
    if abs(turned) > ego.world.constants.heading_aligned_rad:
        return False
    side = ego.half_width_m * math.cos(turned) + ego.half_length_m * abs(math.sin(turned))
    room = max(0.5 * ego.network.lanes[lane].width_m - side, 0.1) + _ENTERED_TOLERANCE_M
    return abs(offset) <= room


def offset_in_lane(ego: Ego, lane: int) -> tuple[float, float]:
    """Offset of a vehicle's centre from a lane's centre line (left positive) and its heading relative to the lane."""
    _, left, heading = ego.place_on(lane)
    return left, math.remainder(ego.pose[2] - heading, 2.0 * math.pi)


def sweeps_somebody(ego: Ego, shift_m: float, way_m: float) -> bool:
    """Whether somebody ahead is in what a vehicle sweeps on a lateral move by ``shift_m``, left positive.

    ``way_m`` is its length, to which the stopping distance is added. Of two whose ways meet the one in front goes
    first.
    """
    sweeps_m, _, ahead_m, left_m, reach_m, side_m = _bodies_near(ego, way_m)
    aside_m = math.copysign(1.0, shift_m) * left_m
    beside = (aside_m > 0.0) & (aside_m - side_m < ego.half_width_m + abs(shift_m))
    return bool(np.any(beside & (ahead_m > 0.0) & (ahead_m - reach_m < sweeps_m)))


def reaches_beside(ego: Ego, lane: int, way_m: float, margin_m: float) -> bool:
    """Whether the body of somebody in another lane than the given one is within ``margin_m`` of a vehicle's way.

    The way goes straight on, on either side and as far as in ``sweeps_somebody``; the body reaches beyond its front.
    """
    sweeps_m, rows, ahead_m, left_m, reach_m, side_m = _bodies_near(ego, way_m)
    others = (ego.traffic.lane[rows] != lane) & (ahead_m + reach_m > ego.half_length_m)
    beside = others & (np.abs(left_m) - side_m < ego.half_width_m + margin_m)
    return bool(np.any(beside & (ahead_m - reach_m < sweeps_m)))


def _bodies_near(ego: Ego, way_m: float) -> tuple[float, Rows, Floats, Floats, Floats, Floats]:
    """How far a vehicle comes, rows of those near, and of each its centre ahead and left and its half extents there."""
    seen, (cos, sin), (x_m, y_m), speed = ego.seen, ego.direction, ego.place, ego.speed_mps
    braking_m = braking_distance_m(speed * speed, ego.civilian_driver.driving.comfort_brake_mps2)
    sweeps_m = ego.half_length_m + way_m + braking_m
    rows = ego.near(sweeps_m + ego.half_length_m)
    dx_m, dy_m = seen.x_m[rows] - x_m, seen.y_m[rows] - y_m
    along = np.minimum(np.abs(cos * seen.cos[rows] + sin * seen.sin[rows]), 1.0)
    across = np.sqrt(1.0 - along * along)
    reach_m = along * seen.half_length_m[rows] + across * seen.half_width_m[rows]
    side_m = across * seen.half_length_m[rows] + along * seen.half_width_m[rows]
    return sweeps_m, rows, cos * dx_m + sin * dy_m, cos * dy_m - sin * dx_m, reach_m, side_m


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
        if side != 0 and _has_less_room(ego, present_lane(ego, unit.navigator), side):
            side = 0
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


def _has_less_room(ego: Ego, lane: int, side: int) -> bool:
    """Whether the next vehicle in the lane to that side is as near as the one in the present lane, or nearer.

    There the EMV would get on no better, or come behind a driver who has just made way for it.
    """
    beside = neighbour_lane(ego.network, lane, side) if lane != NO_LANE else NO_LANE
    there_m = gaps_in_lane(ego, beside).front_m if beside != NO_LANE else math.inf
    return there_m < math.inf and there_m <= gaps_in_lane(ego, lane).front_m


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
        to_route=request.reason == ROUTE,
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
