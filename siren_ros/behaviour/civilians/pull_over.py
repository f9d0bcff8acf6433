"""L3: pull-over to the lane's edge, then braking hold (paper, Algorithm 2, ``npc_behavior_lvl = 2``).

Civilians move up along the lane's edge if an EMV stands behind them, over the stop line if necessary. A civilian
next to a shoulder on which an EMV comes stays where it is if the shoulder is free there.
"""

import math
from dataclasses import replace
from typing import Final

import numpy as np

from siren_ros.behaviour.civilians.rejoin import start_rejoin
from siren_ros.behaviour.civilians.unit import (
    EmvView,
    YieldStep,
    YieldUnit,
    aligned_within_rad,
    lane_of,
    release_reason,
    standing,
    yield_event,
)
from siren_ros.behaviour.civilians.yield_lane_change import defer
from siren_ros.behaviour.driving.lane_change import Refusal, gaps_in_lane, offset_in_lane
from siren_ros.behaviour.driving.navigator import (
    FULL_BRAKE,
    DriveCommand,
    DriveInputs,
    NavigatorState,
    manoeuvring_limit,
    navigate,
)
from siren_ros.behaviour.driving.step_view import StepView
from siren_ros.behaviour.paths.lane_path import (
    LaneEnd,
    LanePath,
    lanes_along,
    nearest_on_lane,
    neighbour_lane,
    path_on_lanes,
    shoulder_into_turn,
)
from siren_ros.behaviour.paths.tracked_path import PEAK_CURVATURE, TrackedPath, blend_length_m, path_onto
from siren_ros.numerics.units import steps_from_s
from siren_ros.roads.movements import road_lane_of
from siren_ros.roads.road_network import NO_LANE, LaneKind
from siren_ros.world.actors import Mode, rows_of_ids
from siren_ros.world.traffic_state import Event, EventKind

_BEHIND: Final = 0.5
"""Cosine between a vehicle's direction and the one from the EMV to it above which the EMV counts as behind."""


def emv_waits_behind(view: StepView, row: int, emv_row: int) -> bool:
    """Whether an EMV stands close behind a vehicle and points towards it."""
    seen = view.seen
    if emv_row < 0 or float(seen.speed_mps[emv_row]) > view.world.constants.gap_escape.blocked_speed_mps:
        return False
    dx, dy = float(seen.x_m[row] - seen.x_m[emv_row]), float(seen.y_m[row] - seen.y_m[emv_row])
    distance = math.hypot(dx, dy)
    if distance > view.world.config.pull_over.room_range_m:
        return False
    ahead = float(seen.cos[emv_row]) * dx + float(seen.sin[emv_row]) * dy
    along = float(seen.cos[row]) * dx + float(seen.sin[row]) * dy
    return min(ahead, along) > _BEHIND * distance


def makes_room(unit: YieldUnit, view: StepView) -> bool:
    """Whether the EMV has been waiting behind a driver for long enough."""
    return unit.emv_waits_steps >= steps_from_s(view.world.config.pull_over.room_after_s)


def may_go_on(unit: YieldUnit, view: StepView, row: int, lane: int) -> bool:
    """Whether a driver who holds has the space to finish the pull-over, or to make room."""
    config = view.world.config.pull_over
    to_finish = config.resume_gap_m if unit.partial else math.inf
    needed_m = min(to_finish, config.room_gap_m if makes_room(unit, view) else math.inf)
    return needed_m < math.inf and gaps_in_lane(view, row, lane).front_m > needed_m


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


_PULL_OVER_MPS: Final = 1.5
"""Speed that a vehicle at rest gets up to on its way to the edge."""
_SETTLED_M: Final = 0.5
_AT_EDGE_M: Final = 0.05
"""Distance from the wanted offset at which the target counts as reached before the lateral move has ended."""
_LEAST_WAY_M: Final = 2.0
"""Way that is worth starting for."""
_STRAIGHT_RAD: Final = 0.04
"""Heading against the lane below which a vehicle gets no straighter by driving on: an end then sticks out by 0.1 m."""
_STANDS_MPS: Final = 1.0
"""Slower vehicles ahead stand, or are about to."""
_CREEP_MPS: Final = 1.0
"""Speed on a way that is only as long as the lateral move: slow enough for the steering."""
_LOOK_AGAIN_STEPS: Final = steps_from_s(0.5)


def start_pull_over(unit: YieldUnit, view: StepView, row: int) -> YieldStep:
    """Starts the pull-over.

    It is deferred on a junction, where the vehicle cannot stop before the next one, and in a queue that stands too
    close. A driver looks again every half second. Who stands where the EMV has its way on the shoulder already stays
    there.
    """
    network, config = view.world.network, view.world.config.pull_over
    looks = view.step % _LOOK_AGAIN_STEPS == unit.actor_id % _LOOK_AGAIN_STEPS
    if unit.deferred and not looks and standing(view, row):
        return YieldStep(unit)
    lane = int(view.traffic.lane[row])
    if road_lane_of(network, lane) == NO_LANE:
        return defer(unit, view, row, Refusal.JUNCTION.value)
    shoulder = emv_takes_shoulder(view, lane, unit.emv_id)
    unit = replace(unit, side=unit.side or (1 if shoulder else alignment_of(view, lane)))
    if shoulder and may_stay(view, row, lane):
        return _stay(unit, view, row, lane)
    path = pull_over_path(unit, view, row, lane)
    speed = float(view.seen.speed_mps[row])
    brake = view.world.config.civilian_navigator.comfort_brake_mps2
    if path is None or speed * speed / (2.0 * brake) > path.length_m + config.length_min_m:
        return defer(unit, view, row, Refusal.NO_ROOM.value)
    x, y, _ = view.pose(row)
    unit = replace(
        unit,
        phase=Mode.YIELD_PULL_OVER,
        deferred="",
        stopped_steps=0,
        navigator=NavigatorState().following(path, x, y),
    )
    started = yield_event(unit, view, row, EventKind.YIELD_STARTED, side=unit.side, lane=lane)
    moved = _drive(unit, view, row)
    return replace(moved, events=(started, *moved.events))


def alignment_of(view: StepView, lane: int) -> int:
    """Side to which the vehicles of a lane pull over: left from the leftmost of several lanes, else right."""
    network = view.world.network
    lane = road_lane_of(network, lane)
    left = neighbour_lane(network, lane, 1)
    right = neighbour_lane(network, lane, -1)
    driving_left = left != NO_LANE and network.lanes[left].kind is LaneKind.DRIVING
    driving_right = right != NO_LANE and network.lanes[right].kind is LaneKind.DRIVING
    return 1 if not driving_left and driving_right else -1


def _stay(unit: YieldUnit, view: StepView, row: int, lane: int) -> YieldStep:
    """Holds where the vehicle stands."""
    started = yield_event(unit, view, row, EventKind.YIELD_STARTED, side=unit.side, lane=lane)
    held = _hold_now(unit, view, row, offset_in_lane(view, row, lane)[0], partial=False)
    return replace(held, events=(started, *held.events))


def edge_offset_m(view: StepView, row: int, lane: int, side: int) -> float:
    """Offset from the lane's centre line at which a vehicle stands at the lane's edge, left positive.

    If that leaves too little width for an EMV on the inner side, the vehicle reaches over the edge. It does not where
    the EMV comes on the shoulder and others stand in the lane on the left.
    """
    network, config = view.world.network, view.world.config.pull_over
    beside = neighbour_lane(network, road_lane_of(network, lane), side)
    shoulder = beside != NO_LANE and network.lanes[beside].kind is LaneKind.SHOULDER
    most = config.shoulder_overhang_max_m if shoulder else config.overhang_max_m
    if side > 0 and beside != NO_LANE and network.lanes[beside].kind is LaneKind.DRIVING:
        most = 0.0
    half_lane, half_width = 0.5 * network.lanes[lane].width_m, float(view.seen.half_width_m[row])
    at_edge = half_lane - half_width
    wanted = config.corridor_half_m - half_lane + half_width
    return side * max(min(max(at_edge, wanted), at_edge + most), 0.0)


def pull_over_path(unit: YieldUnit, view: StepView, row: int, lane: int) -> TrackedPath | None:
    """``BuildPullOverWaypoints``: to the lane's edge, and to a stop there before the next junction.

    Returns:
        The path, or None on a junction and where the lane ends before the vehicle can move sideways.
    """
    network, config = view.world.network, view.world.config.pull_over
    if road_lane_of(network, lane) == NO_LANE:
        return None
    x, y, yaw = view.pose(row)
    speed = float(view.seen.speed_mps[row])
    position, left, _ = nearest_on_lane(network.lanes[lane].centre, x, y)
    offset = edge_offset_m(view, row, lane, unit.side)
    sharpest = math.sqrt(PEAK_CURVATURE * abs(offset - left) / config.curvature_max_1pm)
    navigator = view.navigator_config(row)
    moving = min(max(speed, _PULL_OVER_MPS), view.world.speeds.civilian_pull_over_mps)
    steerable = blend_length_m(offset - left, moving, 0.0, 0.0, navigator)
    wanted = max(config.length_min_m, sharpest, steerable)
    half_length = float(view.seen.half_length_m[row])
    free = _free_m(view, row, lane)
    if free < _LEAST_WAY_M:
        return None
    length = min(wanted + max(config.settle_length_m, 2.0 * half_length), free)
    reference = _line_ahead(unit, view, row, (lane, position), length, wanted)
    room = reference.curve.length_m - 2.0 - half_length
    if room < _LEAST_WAY_M:
        return None
    merge = min(wanted, room)
    if room < sharpest:  # as far sideways as leaves the vehicle straight
        most = config.curvature_max_1pm * room * room / PEAK_CURVATURE
        offset = left + math.copysign(most, offset - left)
    return path_onto(reference, (x, y, yaw), merge, navigator, offset_m=offset, shorten_m=half_length)


def _free_m(view: StepView, row: int, lane: int) -> float:
    """Way up to a standing vehicle ahead, less the distance kept from it; infinite where nobody stands ahead."""
    gaps = gaps_in_lane(view, row, lane)
    if gaps.front_mps > _STANDS_MPS:
        return math.inf
    return gaps.front_m - view.world.config.pull_over.room_standstill_gap_m


def _line_ahead(
    unit: YieldUnit, view: StepView, row: int, place: tuple[int, float], way_m: float, wanted_m: float
) -> LanePath:
    """The lane's centre line to the next junction, and a little beyond the stop line if the space is needed.

    The EMV needs it where it has been waiting; the driver at the head of a standing queue needs it to move sideways,
    and with it everybody behind. Vehicles that stand partly on a shoulder stop before the line: the shoulder does not
    lead across the junction.

    Args:
        unit: The civilian.
        view: The step.
        row: Its row.
        place: Lane and place on it of the vehicle's centre.
        way_m: How far the vehicle goes at most.
        wanted_m: Way that the lateral move takes.
    """
    network, route, config = view.world.network, view.traffic.route_of_row(row), view.world.config.pull_over
    lane, position = place
    half_length = float(view.seen.half_length_m[row])
    ahead = way_m + half_length
    lanes, end = lanes_along(network, lane, position, route, ahead, civilian=True, through_junctions=False)
    beside = neighbour_lane(network, road_lane_of(network, lane), unit.side)
    on_road = beside == NO_LANE or network.lanes[beside].civilian_allowed
    if end is LaneEnd.JUNCTION and on_road:
        to_line = max(sum(network.lanes[item].length_m for item in lanes) - position, 0.0)
        short = to_line - half_length < wanted_m and float(view.seen.speed_mps[row]) < _STANDS_MPS
        over = config.room_over_line_m if makes_room(unit, view) else config.head_over_line_m if short else 0.0
        if over > 0.0:
            ahead = min(ahead, to_line + over)
            lanes, end = lanes_along(network, lane, position, route, ahead, civilian=True)
    return path_on_lanes(network, lanes, end, position - 2.0, 2.0 + ahead)


def pull_over(unit: YieldUnit, view: StepView, row: int, emv: EmvView) -> YieldStep:
    """Drives to the lane's edge. Holds when there and aligned, or when stopped behind another vehicle."""
    if release_reason(emv):
        return _release(unit, view, row, emv)
    config = view.world.config.pull_over
    lane = lane_of(unit, view, row)
    offset, turned = offset_in_lane(view, row, lane)
    wanted = edge_offset_m(view, row, lane, unit.side)
    aligned = abs(turned) <= aligned_within_rad(view, row)
    path = unit.navigator.path
    settled = path is None or unit.navigator.progress_m >= path.settled_m - _SETTLED_M
    reached = abs(offset - wanted) <= (config.reached_m if settled else _AT_EDGE_M)
    stopped = unit.stopped_steps + 1 if standing(view, row) else 0
    if stopped != unit.stopped_steps:
        unit = replace(unit, stopped_steps=stopped)
    going_on = makes_room(unit, view) and not unit.navigator.done
    comes_straight = abs(turned) > _STRAIGHT_RAD and stopped == 0 and not unit.navigator.done
    if reached and aligned and not going_on and not comes_straight:
        return _hold_now(unit, view, row, offset, partial=False)
    if stopped >= steps_from_s(config.blocked_hold_s):
        return _hold_now(unit, view, row, offset, partial=True)
    if unit.navigator.done or (reached and unit.navigator.remaining_m < 1.0):
        extended = pull_over_path(unit, view, row, lane)
        if extended is not None:
            x, y, _ = view.pose(row)
            unit = replace(unit, navigator=unit.navigator.following(extended, x, y))
    return _drive(unit, view, row)


def hold(unit: YieldUnit, view: StepView, row: int, emv: EmvView) -> YieldStep:
    """Stands with full brake and hand brake. Goes on if the pull-over was cut short and there is space again."""
    if release_reason(emv):
        return _release(unit, view, row, emv)
    looks = view.step % _LOOK_AGAIN_STEPS == unit.actor_id % _LOOK_AGAIN_STEPS
    if looks and may_go_on(unit, view, row, lane := lane_of(unit, view, row)):
        path = pull_over_path(unit, view, row, lane)
        if path is not None:
            x, y, _ = view.pose(row)
            navigator = unit.navigator.following(path, x, y)
            unit = replace(unit, phase=Mode.YIELD_PULL_OVER, navigator=navigator, partial=False, stopped_steps=0)
            return _drive(unit, view, row)
    return YieldStep(unit, _braked(unit, view, row))


def _hold_now(unit: YieldUnit, view: StepView, row: int, offset_m: float, partial: bool) -> YieldStep:
    unit = replace(unit, phase=Mode.YIELD_HOLD, partial=partial)
    held = yield_event(unit, view, row, EventKind.YIELD_HELD, side=unit.side, offset_m=offset_m, partial=int(partial))
    return YieldStep(unit, _braked(unit, view, row), (held,))


def _braked(unit: YieldUnit, view: StepView, row: int) -> DriveCommand:
    if standing(view, row):
        return FULL_BRAKE
    situation = DriveInputs(view.seen, row, view.vehicle(row), 0.0, watch=False)
    _, command, _ = navigate(unit.navigator, situation, view.world.config.civilian_navigator)
    return replace(FULL_BRAKE, steer_rad=command.steer_rad)


def _release(unit: YieldUnit, view: StepView, row: int, emv: EmvView) -> YieldStep:
    """Sends the vehicle back to its lane. A yield without a hold, or whose EMV is gone, counts as cancelled."""
    events: tuple[Event, ...] = ()
    if unit.phase is Mode.YIELD_PULL_OVER or not emv.passed:
        events = (yield_event(unit, view, row, EventKind.YIELD_CANCELLED, reason=release_reason(emv)),)
    back = start_rejoin(unit, view, row)
    return replace(back, events=(*events, *back.events))


def _drive(unit: YieldUnit, view: StepView, row: int) -> YieldStep:
    path, config = unit.navigator.path, view.world.config.civilian_navigator
    close = path is not None and path.length_m - path.settled_m < _SETTLED_M
    situation = DriveInputs(
        view.seen,
        row,
        view.vehicle(row),
        _CREEP_MPS if close else view.world.speeds.civilian_pull_over_mps,
        limit=manoeuvring_limit(unit.navigator, view, row),
    )
    if close or makes_room(unit, view):
        config = view.world.room_navigator
    navigator, command, _ = navigate(unit.navigator, situation, config)
    return YieldStep(replace(unit, navigator=navigator), command)
