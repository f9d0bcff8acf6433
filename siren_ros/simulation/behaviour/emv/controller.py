"""Control of the EMV at each step (paper, Algorithm 1): guards, evaluated from top to bottom.

Guard 1, ``gap_escape``, is here: a path through free space around a blocker. Its search looks at the road beside the
route and at the vehicles on it.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from siren_ros.base.numerics.arrays import Floats, changed
from siren_ros.base.numerics.units import NEVER, STEP_S, steps_from_s
from siren_ros.simulation.behaviour.driving.driver_states import (
    EmvUnit,
    Guard,
    GuardResult,
    Refusal,
    advice_of,
    best_lane,
    event_of,
    plan_route,
    present_lane,
)
from siren_ros.simulation.behaviour.driving.lane_change import (
    cancel_lane_change,
    complete_lane_change,
    forced_lane_change,
    gaps_in_lane,
    refusal_of_gaps,
)
from siren_ros.simulation.behaviour.driving.lane_path import road_limits
from siren_ros.simulation.behaviour.driving.navigator import ALONG_COSINE, DriveCommand, Obstacles
from siren_ros.simulation.behaviour.driving.speed_mechanisms import ESCAPE_HORIZON_M, free_way, navigate
from siren_ros.simulation.behaviour.driving.step_view import ActorTable, BehaviourWorld, Ego
from siren_ros.simulation.behaviour.driving.tracked_path import Curve, LaneEnd, LanePath, along_reference
from siren_ros.simulation.behaviour.emv.escape_search import STATION_M, EscapePath, RoadSpace, Start, search_lattice
from siren_ros.simulation.behaviour.emv.rescue_corridor import corridor_mode, corridor_path, way_opens
from siren_ros.simulation.roads.road_network import NO_LANE, LaneKind, RoadNetwork
from siren_ros.simulation.world.actors import NO_ACTOR, Event, EventKind, Lights, Mode, Owner, TrafficState
from siren_ros.simulation.world.commands import CommandRow, VehicleCommands

SOURCE: Final = "emv_controller"


@dataclass(frozen=True, eq=False)
class EmvState:
    """State of all emergency vehicles by id, and the descriptions of all actors."""

    units: Mapping[int, EmvUnit] = field(default_factory=dict)
    actors: ActorTable = field(default_factory=ActorTable.empty)


def step_emv(state: EmvState, traffic: TrafficState, world: BehaviourWorld) -> tuple[EmvState, VehicleCommands]:
    """One step of every EMV that is in traffic.

    Returns:
        The next state, and one command row per EMV, owned by ROS. At a level without privilege (L0) SUMO drives the
        EMV and there are no rows.
    """
    traffic = world.seen(traffic)
    if not world.policy.privileged:
        return EmvState({}, state.actors.updated(traffic)), VehicleCommands.empty(traffic.step, SOURCE)
    view = world.view(traffic, state.actors)
    units: dict[int, EmvUnit] = {}
    rows: list[CommandRow] = []
    events: tuple[Event, ...] = ()
    for row in view.seen.is_emv.nonzero()[0].tolist():
        actor_id = int(traffic.actor_id[row])
        ego = view.ego(row)
        unit, command, happened = _step_unit(state.units.get(actor_id, EmvUnit(actor_id)), ego)
        units[actor_id] = unit
        lights = ego.indicators(unit.change_side)
        lights |= Lights.BEACON | Lights.SIREN if world.policy.siren else Lights.NONE
        rows.append((actor_id, Owner.ROS, *command, mode_of(unit), int(lights)))
        events += happened
    commands = VehicleCommands.of(traffic.step, SOURCE, rows, events)
    return EmvState(units, view.actors), world.said(commands)


def mode_of(unit: EmvUnit) -> Mode:
    """Active behaviour, by priority."""
    if unit.gap_escape_active:
        return Mode.GAP_ESCAPE
    if unit.corridor:
        return Mode.COPY_SUMO
    return Mode.FORCED_LANE_CHANGE if unit.lane_change_forced else Mode.ROUTE_FOLLOW


def target_speed_mps(unit: EmvUnit, ego: Ego) -> float:
    """Guard 5: target speed by priority (paper, table of target speeds)."""
    if unit.gap_escape_active:
        return escape_speed_mps(unit, ego)
    speeds = ego.world.speeds
    if unit.corridor:
        return speeds.emv_copy_sumo_mps
    return speeds.emv_lane_change_mps if unit.lane_change_forced else speeds.emv_route_follow_mps


def _step_unit(unit: EmvUnit, ego: Ego) -> tuple[EmvUnit, DriveCommand, tuple[Event, ...]]:
    guards: tuple[Guard, ...] = (forced_lane_change, waypoints, complete_lane_change)
    guards = (gap_escape_mode, corridor_mode, *guards) if ego.world.policy.corridor else (lane_change_stuck, *guards)
    events: tuple[Event, ...] = ()
    for guard in guards:
        unit, happened = guard(unit, ego)
        events += happened
    navigator, command, blocker_id = navigate(unit, ego, target_speed_mps(unit, ego), ego.world.emv_navigator)
    return changed(unit, navigator=navigator, blocker_id=blocker_id), command, events


def waypoints(unit: EmvUnit, ego: Ego) -> GuardResult:
    """Guard 4: the path comes from the gap escape, the corridor, or the route, in this order."""
    if unit.gap_escape_active:
        return escape_path(unit, ego)
    if unit.corridor:
        return corridor_path(unit, ego), ()
    return follow_route(unit, ego)


_REBUILD_BELOW_M: Final = 80.0
"""The path is extended if less than this remains."""
OFF_PATH_M: Final = 1.5
"""Beyond this distance from the path it is planned again from the present pose."""
_REPLAN_S: Final = 1.0
"""Least time between two plans if SUMO's route and the path disagree."""


def follow_route(unit: EmvUnit, ego: Ego) -> GuardResult:
    """Give the EMV a path along its route: the present one while it is useful, otherwise a new one."""
    navigator = unit.navigator
    plan, path = unit.plan, navigator.path
    events: tuple[Event, ...] = ()
    if plan is None or path is None:
        lane = _lane_after(unit, ego)
    elif abs(navigator.left_m) > OFF_PATH_M or not plan.agrees_with(ego.route):
        if ego.step - plan.planned_step < steps_from_s(_REPLAN_S):
            return unit, ()
        lane = ego.lane
        unit, events = cancel_lane_change(unit, ego, "off_path")
    else:
        ends = plan.end is LaneEnd.HORIZON and navigator.remaining_m < ego.far_m(_REBUILD_BELOW_M)
        if not ends or navigator.progress_m <= path.settled_m:
            return unit, ()
        lane = present_lane(ego, navigator)
    if lane == NO_LANE:
        return unit, events
    plan, navigator = plan_route(ego, lane, navigator)
    return changed(unit, plan=plan, navigator=navigator), events


def _lane_after(unit: EmvUnit, ego: Ego) -> int:
    """Lane of the route's path after a path of another origin: that of the latter where the way into it is free.

    Where somebody is beside or comes, as for a forced lane change, it is the lane that the EMV is in.
    """
    lane, network = present_lane(ego, unit.navigator), ego.network
    apart = NO_LANE not in {lane, ego.lane} and lane != ego.lane
    if unit.navigator.path is None or not apart or network.lanes[lane].edge != network.lanes[ego.lane].edge:
        return lane
    speed_mps, change = ego.speed_mps, ego.emv_driver.lane_change
    refusal = refusal_of_gaps(gaps_in_lane(ego, lane), speed_mps, speed_mps, change)
    return ego.lane if refusal in {Refusal.BESIDE, Refusal.GAP_REAR} else lane


_BEHIND_M: Final = 5.0
"""The reference line begins this far behind the EMV's centre, behind its rear axle."""


def reference_line(ego: Ego, lane: int) -> LanePath:
    """Reference line of the search, along the lanes of the route."""
    length = ESCAPE_HORIZON_M + 10.0
    return ego.line_along(best_lane(ego.network, lane, ego.route), length, _BEHIND_M)


_SWEEP_S: Final = 1.5
"""Time for which moving vehicles are extrapolated in the search."""
_ONCOMING_M: Final = 90.0
"""Distance beyond the horizon within which oncoming vehicles are considered: 50 km/h for that time."""
_STEER_RANGE_SHARE: Final = 0.85
"""Share of the steering range that an escape path may use."""


def search_gap(reference: LanePath, ego: Ego) -> EscapePath | None:
    """Find the best path along a reference line that the EMV's footprint clears with a margin.

    Vehicles are swept along their motion, those that cross the EMV's direction for longer. Oncoming ones are swept for
    as long as the EMV needs to the end of the path: it takes their lane only if nobody comes there meanwhile.

    Returns:
        The path, or None where no path is long enough to be worth driving.
    """
    config, vehicle = ego.emv_driver.gap_escape, ego.vehicle
    body, rear = ego.body, vehicle.centre_ahead_of_rear_axle_m
    x, y, yaw = ego.pose
    curve = reference.curve
    s0, left = curve.project_one(x - rear * math.cos(yaw), y - rear * math.sin(yaw))
    room = min(ESCAPE_HORIZON_M, curve.length_m - s0 - body.half_length_m - rear)
    count = int(room / STATION_M) + 1
    if count < 3:
        return None
    turned = math.remainder(yaw - curve.place(s0)[2], 2.0 * math.pi)
    slope = math.tan(max(-0.7, min(0.7, turned)))
    sharpest = math.tan(_STEER_RANGE_SHARE * vehicle.max_steer_rad) / vehicle.wheelbase_m
    start = Start(left, slope, body, rear, vehicle.wheelbase_m, sharpest)
    road = road_space(ego.network, reference, s0 + STATION_M * np.arange(count))
    rows = ego.near(ESCAPE_HORIZON_M + _ONCOMING_M)
    ahead = np.cos(ego.seen.yaw_rad[rows] - yaw)
    times = _SWEEP_S, config.oncoming_s, config.crossing_s
    sweep_s = np.select([ahead > ALONG_COSINE, ahead < -ALONG_COSINE], times[:2], times[2])
    obstacles = Obstacles.swept(ego.seen, rows, sweep_s)
    return search_lattice(curve, road, start, obstacles, config)


def road_space(network: RoadNetwork, reference: LanePath, s_m: Floats) -> RoadSpace:
    """Edges of the road along a reference line, interpolated across junctions."""
    lane_of = reference.lane_at(s_m)
    edges = np.full((5, len(s_m)), np.nan)
    for lane in dict.fromkeys(lane_of.tolist()):
        if network.lanes[lane].kind is not LaneKind.INTERNAL:
            road = road_limits(network, lane)
            middle = 0.5 * (road.driving_right_m + road.left_m)
            values = (road.right_m, road.driving_right_m, road.left_m, road.left_m + road.opposite_road_m, middle)
            edges[:, lane_of == lane] = np.array(values)[:, None]
    known = np.isfinite(edges[0])
    if known.any():
        return RoadSpace(s_m, *(np.interp(s_m, s_m[known], line[known]) for line in edges))
    edges[:] = np.array([-1.5, -1.5, 1.5, 1.5, 0.0])[:, None] * network.lanes[int(lane_of[0])].width_m
    return RoadSpace(s_m, *edges)


def gap_escape_mode(unit: EmvUnit, ego: Ego) -> GuardResult:
    """Latches the gap escape: begun after a sustained stop behind a blocker, ended some time after the last one.

    While drivers ahead move aside, the EMV waits for the corridor.
    """
    constants = ego.world.constants.gap_escape
    blocker = blocker_of(unit, ego)
    blocked = ego.speed_mps <= constants.blocked_speed_mps and not way_opens(unit, ego)
    stopped_s = unit.stopped_s + STEP_S if blocked else 0.0
    free_s = 0.0 if blocker != NO_ACTOR else unit.blocker_free_s + STEP_S
    unit = changed(unit, stopped_s=stopped_s, blocker_free_s=free_s)
    if unit.gap_escape_active and unit.blocker_free_s >= constants.blocker_grace_s - 0.5 * STEP_S:
        unit = changed(unit, gap_escape_active=False, escape_offset_m=None, plan=None, corridor_planned_step=NEVER)
        return unit, (event_of(ego, EventKind.GAP_ESCAPE_LEFT),)
    long_enough = unit.stopped_s >= constants.stop_before_entry_s - 0.5 * STEP_S
    if blocker == NO_ACTOR or not long_enough or unit.gap_escape_active:
        return unit, ()
    unit, cancelled = cancel_lane_change(unit, ego, "gap_escape")
    unit = changed(unit, gap_escape_active=True, escape_offset_m=None, escape_planned_step=NEVER)
    return unit, (*cancelled, event_of(ego, EventKind.GAP_ESCAPE_ENTERED, blocker))


def lane_change_stuck(unit: EmvUnit, ego: Ego) -> GuardResult:
    """Without corridors, an EMV escapes only from a forced lane change that stands still.

    It may stand too close behind a vehicle for the path of a lane change, with a free lane beside it.
    """
    if unit.lane_change_forced or unit.gap_escape_active:
        return gap_escape_mode(unit, ego)
    return (changed(unit, stopped_s=0.0) if unit.stopped_s else unit), ()


_BLOCKER_RANGE_M: Final = 15.0
"""During an escape, a vehicle ahead in the EMV's lane blocks it if the free distance is smaller."""


def blocker_of(unit: EmvUnit, ego: Ego) -> int:
    """The actor that blocks the EMV: SUMO's leader within the query range, otherwise the navigator's blocker.

    A leader that drives faster than the escape's own target speed does not block. While the escape is active, the
    navigator's collision handling is off: the blocker is then the vehicle ahead in the EMV's lane, or one that closes
    its path. A vehicle that a moving EMV would pass sideways does not block, unless the EMV is on the opposite lane: it
    has to get past the vehicle before it can come back.
    """
    advice, passed = advice_of(ego, unit.actor_id), NO_ACTOR
    stopped = ego.speed_mps <= ego.world.constants.gap_escape.blocked_speed_mps
    lane = present_lane(ego, unit.navigator) if unit.gap_escape_active else NO_LANE
    stopped = stopped or (lane != NO_LANE and on_opposite_lane(ego, lane))
    if advice is not None and advice.leader_id != NO_ACTOR:
        rows = np.flatnonzero(ego.seen.actor_id == advice.leader_id)
        slow = len(rows) == 0 or ego.seen.speed_mps[rows[0]] < ego.world.speeds.emv_gap_escape_mps
        if slow and advice.leader_gap_m <= ego.world.constants.leader_query_m:
            if lane == NO_LANE or len(rows) == 0 or stopped or in_the_way(ego, int(rows[0]), lane):
                return advice.leader_id
            passed = advice.leader_id
    if lane != NO_LANE:
        gaps = gaps_in_lane(ego, lane)
        if gaps.front_m < _BLOCKER_RANGE_M and gaps.front_id != passed:
            other = int(np.flatnonzero(ego.seen.actor_id == gaps.front_id)[0])
            if stopped or in_the_way(ego, other, lane):
                return gaps.front_id
    return unit.blocker_id


def on_opposite_lane(ego: Ego, lane: int) -> bool:
    """Whether the EMV reaches over the left edge of its direction's part of the road."""
    if ego.network.lanes[lane].kind is LaneKind.INTERNAL:
        return False
    road, left_m = road_limits(ego.network, lane), ego.place_on(lane)[1]
    return road.opposite_m > 0.0 and left_m + ego.half_width_m > road.left_m + ego.emv_driver.gap_escape.edge_overhang_m


def in_the_way(ego: Ego, other: int, lane: int) -> bool:
    """Whether the EMV would meet another vehicle if it kept its lateral offset."""
    seen, both = ego.seen, np.array([ego.row, other])
    curve = reference_line(ego, lane).curve
    _, left, nearest = curve.project(seen.x_m[both], seen.y_m[both])
    turned = seen.yaw_rad[both] - curve.heading_rad[nearest]
    half = np.abs(np.cos(turned)) * seen.half_width_m[both] + np.abs(np.sin(turned)) * seen.half_length_m[both]
    return bool(abs(left[1] - left[0]) < half.sum() + ego.emv_driver.corridor.clearance_m)


_SEARCH_EVERY_S: Final = 0.5
"""Time between two searches."""
_REPLAN_BELOW_M: Final = 15.0
"""A free path is kept while more than this remains."""
_USABLE_M: Final = 1.0
"""Least free distance on the present path; while it is free and no other path is found, the path is kept."""
_OFF_PATH_M: Final = 0.3
"""Distance from the path above which another one is searched."""


def escape_path(unit: EmvUnit, ego: Ego) -> GuardResult:
    """``BuildGapEscapeWaypoints``: give the EMV a path through free space, planned again at intervals.

    A path that is free to its end and still long enough is kept. If no other path is found, the present one is driven
    as far as it is free.
    """
    lane = present_lane(ego, unit.navigator)
    if lane == NO_LANE or ego.step - unit.escape_planned_step < steps_from_s(_SEARCH_EVERY_S):
        return unit, ()
    first, driving = unit.escape_planned_step < 0, unit.escape_offset_m is not None
    unit = changed(unit, escape_planned_step=ego.step, plan=None)
    way = free_way(unit, ego)
    ahead = min(way.free_m if way is not None else 0.0, unit.navigator.remaining_m)
    on_path = abs(unit.navigator.left_m) < _OFF_PATH_M
    if driving and on_path and ahead >= max(unit.navigator.remaining_m, _REPLAN_BELOW_M):
        return unit, ()
    reference = reference_line(ego, lane)
    escape = search_gap(reference, ego)
    if escape is not None:
        return _following(unit, escape, reference, ego)
    if driving and ahead > _USABLE_M:
        return unit, ()
    waiting = (event_of(ego, EventKind.GAP_ESCAPE_WAITING),) if first or driving else ()
    return changed(unit, escape_offset_m=None), waiting


_STEER_SHARE: Final = 0.5
"""Share of the steering rate that an escape path may need, relative to other paths."""
_SAME_OFFSET_M: Final = 0.5
"""Paths whose ends are nearer than this lead to the same place."""
_SMOOTHING_M: Final = 0.7
"""Standard deviation of the Gaussian that smooths a path's curvature."""


def _following(unit: EmvUnit, escape: EscapePath, reference: LanePath, ego: Ego) -> GuardResult:
    config, base, ahead = (
        ego.emv_driver.gap_escape,
        ego.navigator_config,
        ego.vehicle.centre_ahead_of_rear_axle_m,
    )
    curve = Curve.through(escape.centre_line(reference.curve, ahead), _SMOOTHING_M)
    rate_1pms = _STEER_SHARE * base.curvature_rate_1pms
    slowly = changed(base, lateral_accel_mps2=config.bend_accel_mps2, curvature_rate_1pms=rate_1pms)
    path = along_reference(curve, reference, escape.s_m + ahead, slowly, escape.length_m, stop_at_end=True)
    before, left = unit.escape_offset_m, float(escape.left_m[-1])
    navigator = unit.navigator.following(path, *ego.place)
    unit = changed(unit, navigator=navigator, escape_offset_m=left, escape_clearance_m=escape.clearance_m)
    if before is not None and abs(left - before) < _SAME_OFFSET_M:
        return unit, ()
    margin = escape.clearance_m
    planned = event_of(ego, EventKind.GAP_ESCAPE_REPLANNED, left_m=left, free_m=escape.length_m, clearance_m=margin)
    return unit, (planned,)


def escape_speed_mps(unit: EmvUnit, ego: Ego) -> float:
    """Target speed of the gap escape: the paper's, less in a tight gap, and 0 while there is no path."""
    if unit.escape_offset_m is None:
        return 0.0
    squeeze = dict(ego.emv_driver.gap_escape.squeezes).get(unit.escape_clearance_m, math.inf)
    return min(ego.world.speeds.emv_gap_escape_mps, squeeze)
