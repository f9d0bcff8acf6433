"""L3: pull-over to the lane's edge, then braking hold (paper, Algorithm 2, ``npc_behavior_lvl = 2``).

Civilians move up along the lane's edge if an EMV stands behind them: at a red light into the junction, as far as they
stay clear of others there, and otherwise across it. A civilian next to a shoulder on which an EMV comes stays where it
is if the shoulder is free there.
"""

import math
from typing import Final

import numpy as np

from siren_ros.base.numerics.arrays import changed
from siren_ros.base.numerics.braking import braking_distance_m
from siren_ros.base.numerics.units import steps_from_s
from siren_ros.simulation.behaviour.civilians.yield_lane_change import (
    LEAST_SIDEWAYS_M,
    OFF_PATH_GRACE_S,
    approach_lane_of,
    defer,
    junction_m,
    may_enter,
    movement_from,
    on_junction,
    room_beyond_line_m,
    start_rejoin,
    way_inside_m,
)
from siren_ros.simulation.behaviour.driving.driver_states import (
    EmvView,
    Refusal,
    YieldStep,
    YieldUnit,
    aligned_within_rad,
    lane_of,
    release_reason,
    standing,
    yield_event,
)
from siren_ros.simulation.behaviour.driving.lane_change import gaps_in_lane, offset_in_lane
from siren_ros.simulation.behaviour.driving.lane_path import (
    SHOULDER_REACH_M,
    connection_of_internal,
    lanes_along,
    neighbour_lane,
    path_on_lanes,
    shoulder_into_turn,
)
from siren_ros.simulation.behaviour.driving.navigator import ALONG_COSINE, FULL_BRAKE, SPEED_GAIN_1PS, NavigatorState
from siren_ros.simulation.behaviour.driving.speed_mechanisms import navigate
from siren_ros.simulation.behaviour.driving.step_view import Ego
from siren_ros.simulation.behaviour.driving.tracked_path import (
    PEAK_CURVATURE,
    LaneEnd,
    LanePath,
    TrackedPath,
    blend_length_m,
    path_onto,
)
from siren_ros.simulation.roads.road_network import NO_LANE, Connection, LaneKind, RoadNetwork
from siren_ros.simulation.roads.routing import road_lane_of
from siren_ros.simulation.world.actors import Event, EventKind, Mode, rows_of_ids

_LOOK_AGAIN_S: Final = 0.5
"""Time between two checks of a waiting driver."""


def _looks(unit: YieldUnit, ego: Ego) -> bool:
    """Whether a waiting driver checks again at this step; drivers check at different steps."""
    period = steps_from_s(_LOOK_AGAIN_S)
    return ego.step % period == unit.actor_id % period


_ROOM_RANGE_M: Final = 60.0
"""Largest distance to an EMV waiting behind for which a driver makes way."""
_BEHIND_COSINE: Final = 0.5
"""An EMV counts as behind if the cosine between the vehicle's direction and that from the EMV to it is above this."""


def emv_waits_behind(ego: Ego, emv_row: int) -> bool:
    """Whether an EMV stands or drives very slowly close behind a vehicle and points towards it."""
    seen = ego.seen
    if emv_row < 0 or float(seen.speed_mps[emv_row]) > ego.civilian_driver.pull_over.emv_crawls_mps:
        return False
    dx, dy = float(seen.x_m[ego.row] - seen.x_m[emv_row]), float(seen.y_m[ego.row] - seen.y_m[emv_row])
    distance = math.hypot(dx, dy)
    if distance > _ROOM_RANGE_M:
        return False
    cos, sin = ego.direction
    ahead = float(seen.cos[emv_row]) * dx + float(seen.sin[emv_row]) * dy
    return min(ahead, cos * dx + sin * dy) > _BEHIND_COSINE * distance


def makes_room(unit: YieldUnit, ego: Ego) -> bool:
    """Whether the EMV has waited behind a driver long enough."""
    return unit.emv_waits_steps >= steps_from_s(ego.civilian_driver.pull_over.room_after_s)


def may_go_on(unit: YieldUnit, ego: Ego, lane: int) -> bool:
    """Whether a holding driver has space to finish the pull-over, or to make way."""
    config = ego.civilian_driver.pull_over
    if lane == NO_LANE:
        return False
    reasons = ((unit.partial, config.resume_gap_m), (makes_room(unit, ego), config.room_gap_m))
    needed_m = min((gap_m for reason, gap_m in reasons if reason), default=math.inf)
    return needed_m < math.inf and gaps_in_lane(ego, lane).front_m > needed_m


def _row_of(ego: Ego, emv_id: int) -> int:
    """Row of an EMV; −1 if it is not on the map."""
    return int(rows_of_ids(ego.seen.actor_id, np.array([emv_id], dtype=np.uint32))[0])


def emv_takes_shoulder(ego: Ego, lane: int, emv_id: int) -> bool:
    """Whether the EMV indicates and will use the shoulder, so that all drivers there go left."""
    network, row = ego.network, _row_of(ego, emv_id)
    if row < 0:
        return False
    way = shoulder_into_turn(network, ego.traffic.route_of_row(row), SHOULDER_REACH_M)
    return way is not None and network.lanes[road_lane_of(network, lane)].edge in way.edges


_ALONGSIDE_M: Final = 15.0
"""Distance along the road within which a neighbouring driver gives a vehicle space to move sideways."""


def _leaves_shoulder_free(ego: Ego, lane: int) -> bool:
    """Whether a vehicle leaves an EMV's width between its right side and the shoulder's outer edge.

    In the lanes farther left the vehicles leave it free where those on their right do.
    """
    network, lane = ego.network, road_lane_of(ego.network, lane)
    right = neighbour_lane(network, lane, -1)
    if right == NO_LANE:
        return False
    if network.lanes[right].kind is LaneKind.DRIVING:
        apart = np.abs(ego.traffic.lane_position_m - ego.traffic.lane_position_m[ego.row])
        near = np.flatnonzero((ego.traffic.lane == right) & (apart < _ALONGSIDE_M))
        return all(_leaves_shoulder_free(ego.ego(other), right) for other in near.tolist())
    offset, turned = offset_in_lane(ego, lane)
    if network.lanes[right].kind is not LaneKind.SHOULDER or abs(turned) > aligned_within_rad(ego):
        return False
    beyond = 0.5 * network.lanes[lane].width_m + offset - ego.half_width_m
    return network.lanes[right].width_m + beyond >= ego.civilian_driver.pull_over.shoulder_free_m


_RIDER_S: Final = 3.0
"""Duration of a pull-over: riders who will be next to the vehicle in this time go first."""
_RIDER_CLEAR_M: Final = 0.3
"""Lateral distance kept to riders."""


def rider_comes_up(ego: Ego, side: int, shift_m: float) -> bool:
    """Whether a cyclist or motorcyclist is next to a vehicle that will move sideways, or approaches from behind.

    Those count who are where the body moves to, by ``shift_m`` to its ``side``, and not all behind it.
    """
    rows, seen, (cos, sin) = ego.seen.riders, ego.seen, ego.direction
    rows = rows[rows != ego.row]
    if not len(rows):
        return False
    dx, dy, half_m = seen.x_m[rows] - ego.place[0], seen.y_m[rows] - ego.place[1], seen.half_width_m[rows]
    ahead_m, aside_m = cos * dx + sin * dy, side * (cos * dy - sin * dx)
    lengths_m = ego.half_length_m + seen.half_length_m[rows]
    slowed_mps = min(ego.speed_mps, ego.world.speeds.civilian_pull_over_mps)
    way_m = lengths_m + _RIDER_S * np.maximum(seen.speed_mps[rows] - slowed_mps, 0.0)
    there = (aside_m + half_m > ego.half_width_m) & (aside_m - half_m < ego.half_width_m + shift_m + _RIDER_CLEAR_M)
    along = cos * seen.cos[rows] + sin * seen.sin[rows] > ALONG_COSINE
    return bool(np.any(there & along & (ahead_m < lengths_m) & (ahead_m > -way_m)))


_STAYS_BELOW_MPS: Final = 1.5
"""A slower vehicle next to a shoulder that it leaves free stops where it is."""


def start_pull_over(unit: YieldUnit, ego: Ego) -> YieldStep:
    """Start the pull-over.

    It is deferred on a junction while no EMV has waited behind, where the vehicle cannot stop before the next one, in a
    queue that stands too close, and while a rider comes up on that side. A driver looks again every half second. A
    vehicle that leaves the EMV's way on the shoulder free stays there.
    """
    network = ego.network
    if unit.deferred and not _looks(unit, ego) and standing(ego):
        return YieldStep(unit)
    lane, road = ego.lane, approach_lane_of(ego, ego.lane)
    if road == NO_LANE or (on_junction(ego, lane) and not makes_room(unit, ego)):
        return defer(unit, ego, Refusal.JUNCTION.value)
    shoulder = emv_takes_shoulder(ego, road, unit.emv_id)
    unit = changed(unit, side=unit.side or (1 if shoulder else alignment_of(network, road)))
    if shoulder and ego.speed_mps < _STAYS_BELOW_MPS and _leaves_shoulder_free(ego, lane):
        started = yield_event(unit, ego, EventKind.YIELD_STARTED, side=unit.side, lane=lane)
        return _hold_now(unit, ego, offset_in_lane(ego, lane)[0], partial=False).preceded_by(started)
    path = pull_over_path(unit, ego, lane)
    stop = braking_distance_m(ego.speed_mps * ego.speed_mps, ego.civilian_driver.driving.comfort_brake_mps2)
    if path is None or stop > path.length_m + LEAST_SIDEWAYS_M:
        return defer(unit, ego, Refusal.NO_ROOM.value)
    shift_m = unit.side * (edge_offset_m(ego, lane, unit.side) - offset_in_lane(ego, lane)[0])
    if rider_comes_up(ego, unit.side, shift_m):
        return defer(unit, ego, Refusal.BESIDE.value)
    navigator = NavigatorState().following(path, *ego.place)
    unit = changed(unit, phase=Mode.YIELD_PULL_OVER, deferred="", stopped_steps=0, navigator=navigator)
    started = yield_event(unit, ego, EventKind.YIELD_STARTED, side=unit.side, lane=lane)
    return _drive(unit, ego).preceded_by(started)


def pull_over_again(unit: YieldUnit, ego: Ego) -> YieldStep | None:
    """A driver on the way back to the lane pulls over from there, or stops if that is impossible.

    None while the vehicle moves and cannot: it goes on with its way back.
    """
    again = start_pull_over(changed(unit, side=0, deferred="", partial=False, emv_waits_steps=0), ego)
    if again.command is not None:
        return again
    lane = lane_of(unit, ego)
    if lane == NO_LANE or not standing(ego):
        return None
    return _hold_now(
        changed(unit, side=alignment_of(ego.network, lane)), ego, offset_in_lane(ego, lane)[0], partial=True
    )


def alignment_of(network: RoadNetwork, lane: int) -> int:
    """Side to which vehicles of a lane pull over: left from the leftmost of several lanes, otherwise right."""
    beside = [neighbour_lane(network, road_lane_of(network, lane), side) for side in (1, -1)]
    left, right = (other != NO_LANE and network.lanes[other].kind is LaneKind.DRIVING for other in beside)
    return 1 if not left and right else -1


def edge_offset_m(ego: Ego, lane: int, side: int) -> float:
    """Offset from the lane's centre line at which a vehicle stands at the lane's edge, positive to the left.

    On a junction, what lies beside the lane before it counts, so that the way leads straight on. If too little width is
    left for an EMV on the inner side, the vehicle reaches over the edge. It does not where the EMV comes on the
    shoulder and others stand in the lane on the left.
    """
    network, config = ego.network, ego.civilian_driver.pull_over
    road = approach_lane_of(ego, lane)
    beside = NO_LANE if road == NO_LANE else neighbour_lane(network, road, side)
    shoulder = beside != NO_LANE and network.lanes[beside].kind is LaneKind.SHOULDER
    most = config.shoulder_overhang_max_m if shoulder else config.overhang_max_m
    if side > 0 and beside != NO_LANE and network.lanes[beside].kind is LaneKind.DRIVING:
        most = 0.0
    half_lane, half_width = 0.5 * network.lanes[lane].width_m, ego.half_width_m
    at_edge = half_lane - half_width
    for_emv = config.corridor_half_m - half_lane + half_width
    return side * max(min(max(at_edge, for_emv), at_edge + most), 0.0)


CURVATURE_MAX_1PM: Final = 0.15
"""Sharpest bend of a pull-over."""
SETTLE_LENGTH_M: Final = 4.0
"""Least straight distance after the lateral move; long vehicles need their own length to become straight."""
_LEAST_WAY_M: Final = 2.0
"""Least distance for which a driver starts to move."""
_LEADER_STANDS_MPS: Final = 1.0
"""Slower vehicles ahead stand or will stop."""


def pull_over_path(unit: YieldUnit, ego: Ego, lane: int) -> TrackedPath | None:
    """``BuildPullOverWaypoints``: path to the lane's edge, with a stop there before the next junction.

    Returns:
        The path, or None where the lane ends before the vehicle can move sideways, and on a junction where the driver
        makes no room.
    """
    config = ego.civilian_driver.pull_over
    if approach_lane_of(ego, lane) == NO_LANE or (on_junction(ego, lane) and not makes_room(unit, ego)):
        return None
    position, left, _ = ego.place_on(lane)
    offset = edge_offset_m(ego, lane, unit.side)
    sharpest = math.sqrt(PEAK_CURVATURE * abs(offset - left) / CURVATURE_MAX_1PM)
    moving = min(max(ego.speed_mps, config.start_mps), ego.world.speeds.civilian_pull_over_mps)
    steerable = blend_length_m(offset - left, moving, 0.0, 0.0, ego.navigator_config)
    sideways_m = max(LEAST_SIDEWAYS_M, sharpest, steerable)
    if ego.row in ego.seen.riders:
        # Standing vehicles follow their steering at once; others have slowed down before they turn.
        lean = math.sqrt(PEAK_CURVATURE * abs(offset - left) / ego.navigator_config.lateral_accel_mps2)
        sideways_m = max(sideways_m, lean * ego.speed_mps)
    half_length, gaps = ego.half_length_m, gaps_in_lane(ego, lane)
    free = math.inf if gaps.front_mps > _LEADER_STANDS_MPS else gaps.front_m - config.room_standstill_gap_m
    if free < _LEAST_WAY_M:
        return None
    length = min(sideways_m + max(SETTLE_LENGTH_M, 2.0 * half_length), free)
    reference = _line_ahead(unit, ego, (lane, position), length, sideways_m)
    room = reference.curve.length_m - 2.0 - half_length
    if room < _LEAST_WAY_M:
        return None
    merge = min(sideways_m, room)
    if room < sharpest:  # a smaller lateral move, after which the vehicle is still straight
        most = CURVATURE_MAX_1PM * room * room / PEAK_CURVATURE
        offset = left + math.copysign(most, offset - left)
    return path_onto(reference, ego.pose, merge, ego.navigator_config, offset_m=offset, shorten_m=half_length)


_BEYOND_JUNCTION_M: Final = 2.0
"""Distance between the junction and the rear of a vehicle that has left it."""


def _line_ahead(unit: YieldUnit, ego: Ego, place: tuple[int, float], way_m: float, sideways_m: float) -> LanePath:
    """Reference line along the lane to the next junction, and beyond the stop line if the space is needed.

    The EMV needs it where it has been waiting; the driver at the head of a standing queue needs it to move sideways,
    and with it everybody behind. Vehicles that stand partly on a shoulder stop before the line: the shoulder does not
    lead across the junction.

    ``place`` is the lane of the vehicle's centre and where on it, ``way_m`` how far the vehicle goes at most,
    ``sideways_m`` the way that the lateral move takes.
    """
    network, route, config, (lane, position) = ego.network, ego.route, ego.civilian_driver.pull_over, place
    ahead, room = way_m + ego.half_length_m, makes_room(unit, ego)
    lanes, end = lanes_along(network, lane, position, route, ahead, civilian=True, through_junctions=False)
    to_line = network.length_m(lanes) - position
    short = to_line - ego.half_length_m < sideways_m and ego.speed_mps < _LEADER_STANDS_MPS
    over = config.room_over_line_m if room else config.head_over_line_m if short else 0.0
    if on_junction(ego, lane):
        movement = connection_of_internal(network, lane, route)
        to_line = -position
        if movement is not None:
            to_line -= way_inside_m(ego, movement, lane)
    else:
        beside = neighbour_lane(network, road_lane_of(network, lane), unit.side)
        on_road = beside == NO_LANE or network.lanes[beside].kind is not LaneKind.SHOULDER
        movement = movement_from(ego, lanes[-1]) if end is LaneEnd.JUNCTION and on_road and over > 0.0 else None
    if movement is not None:
        if room and may_enter(ego, movement, ego.half_length_m - to_line, urgent=True):
            ahead = to_line + junction_m(ego, movement) + 2.0 * ego.half_length_m + _BEYOND_JUNCTION_M
            # Those between the EMV and this driver follow, and need as much road.
            emv = _row_of(ego, unit.emv_id)
            ahead += ego.distance_m(emv) if emv >= 0 else 0.0
        else:
            beyond_m = room_beyond_line_m(ego, movement, urgent=room, side=unit.side)
            ahead = min(ahead, to_line + min(over, beyond_m))
        lanes, end = lanes_along(network, lane, position, route, ahead, civilian=True)
    return path_on_lanes(network, lanes, end, position - 2.0, 2.0 + max(ahead, 0.0))


def _crossing(unit: YieldUnit, ego: Ego) -> tuple[bool, bool]:
    """Whether a driver's path leads across a junction that the vehicle has not reached, or that it has."""
    path = unit.navigator.path
    if path is None:
        return False, False
    inside = [on_junction(ego, lane) for lane in path.lane.tolist()]
    over = any(inside) and not inside[-1]
    reached = any(inside[: path.index_at(unit.navigator.progress_m + ego.half_length_m) + 1])
    return over and not reached, over and reached


def _may_go(unit: YieldUnit, ego: Ego, movement: Connection | None) -> bool:
    """Whether a driver before the line of a movement may still cross the junction."""
    return movement is None or may_enter(ego, movement, 0.0, urgent=makes_room(unit, ego))


_REACHED_M: Final = 0.15
"""The target is reached within this distance of the intended offset."""
_SETTLED_M: Final = 0.5
"""The lateral move counts as ended this far before its end."""
_AT_EDGE_M: Final = 0.05
"""Before the end of the lateral move, the target is reached within this smaller distance."""
_STRAIGHT_RAD: Final = 0.04
"""Heading error below which driving on does not straighten a vehicle: its end sticks out by 0.1 m."""


def pull_over(unit: YieldUnit, ego: Ego, emv: EmvView) -> YieldStep:
    """Drive to the lane's edge. It holds when the vehicle is there and aligned, or has stopped behind another one.

    A driver who crosses a junction to make room does not hold on it, nor before the end of the way.
    """
    unit, over = _is_over(unit, emv)
    if over:
        return _release(unit, ego, emv, over)
    config, lane, path = ego.civilian_driver.pull_over, lane_of(unit, ego), unit.navigator.path
    offset, turned = offset_in_lane(ego, lane)
    aligned = abs(turned) <= aligned_within_rad(ego)
    settled = path is None or unit.navigator.progress_m >= path.settled_m - _SETTLED_M
    off_edge_m = abs(offset - edge_offset_m(ego, lane, unit.side))
    reached = off_edge_m <= (_REACHED_M if settled else _AT_EDGE_M)
    stopped = unit.stopped_steps + 1 if standing(ego) else 0
    if stopped != unit.stopped_steps:
        unit = changed(unit, stopped_steps=stopped)
    will_cross, crosses = _crossing(unit, ego)
    going_on = (makes_room(unit, ego) or crosses) and not unit.navigator.done
    comes_straight = abs(turned) > _STRAIGHT_RAD and stopped == 0 and not unit.navigator.done
    if reached and aligned and not going_on and not comes_straight:
        return _hold_now(unit, ego, offset, partial=False)
    if stopped >= steps_from_s(config.blocked_hold_s):
        return _hold_now(unit, ego, offset, partial=True)
    ends = unit.navigator.done or (reached and unit.navigator.remaining_m < 1.0)
    turns_red = will_cross and not _may_go(unit, ego, movement_from(ego, approach_lane_of(ego, lane)))
    if (ends or turns_red) and (other := pull_over_path(unit, ego, lane)) is not None:
        unit = changed(unit, navigator=unit.navigator.following(other, *ego.place))
    elif turns_red:
        return _hold_now(unit, ego, offset, partial=True)
    return _drive(unit, ego)


def hold(unit: YieldUnit, ego: Ego, emv: EmvView) -> YieldStep:
    """Brake to a standstill, then stand with full brake and hand brake.

    Goes on if the pull-over was cut short and there is space again, or to make room for an EMV that waits behind.
    """
    unit, over = _is_over(unit, emv)
    if over:
        return _release(unit, ego, emv, over)
    goes_on = _looks(unit, ego) and may_go_on(unit, ego, lane := lane_of(unit, ego))
    if goes_on and (path := pull_over_path(unit, ego, lane)) is not None:
        navigator = unit.navigator.following(path, *ego.place)
        unit = changed(unit, phase=Mode.YIELD_PULL_OVER, navigator=navigator, partial=False, stopped_steps=0)
        return _drive(unit, ego)
    return _braked(unit, ego)


def _hold_now(unit: YieldUnit, ego: Ego, offset_m: float, partial: bool) -> YieldStep:
    unit = changed(unit, phase=Mode.YIELD_HOLD, partial=partial)
    held = yield_event(unit, ego, EventKind.YIELD_HELD, side=unit.side, offset_m=offset_m, partial=int(partial))
    return _braked(unit, ego).preceded_by(held)


def _braked(unit: YieldUnit, ego: Ego) -> YieldStep:
    """A comfortable stop; at standstill the paper's full brake and hand brake keep the vehicle in place.

    The target speed falls with the speed: who wants to stand at once looks at nobody ahead.
    """
    if standing(ego):
        return YieldStep(unit, FULL_BRAKE)
    config = ego.world.hold_navigator
    target_mps = max(ego.speed_mps - config.ease_off_mps2 / SPEED_GAIN_1PS, 0.0)
    navigator, command, _ = navigate(unit, ego, target_mps, config)
    return YieldStep(changed(unit, navigator=navigator), command)


def _is_over(unit: YieldUnit, emv: EmvView) -> tuple[YieldUnit, str]:
    """Reason why a yield has no purpose any more, empty if it has: the EMV has passed, is gone, or has turned off.

    An EMV that has passed and crawls right ahead has not got away yet.
    """
    off_path = unit.off_path_steps + 1 if emv.turned_off else 0
    if off_path != unit.off_path_steps:
        unit = changed(unit, off_path_steps=off_path)
    grace = steps_from_s(OFF_PATH_GRACE_S)
    if emv.passed and emv.dawdles:
        return unit, ""
    return unit, release_reason(emv) or ("off_path" if off_path > grace else "")


def _release(unit: YieldUnit, ego: Ego, emv: EmvView, reason: str) -> YieldStep:
    """Send the vehicle back to its lane. A yield without a hold, or whose EMV is gone, counts as cancelled."""
    events: tuple[Event, ...] = ()
    if unit.phase is Mode.YIELD_PULL_OVER or not emv.passed:
        events = (yield_event(unit, ego, EventKind.YIELD_CANCELLED, reason=reason),)
    return start_rejoin(unit, ego).preceded_by(*events)


def _drive(unit: YieldUnit, ego: Ego) -> YieldStep:
    path, config = unit.navigator.path, ego.world.civilian_navigator
    close = path is not None and path.length_m - path.settled_m < _SETTLED_M
    if close or makes_room(unit, ego):
        config = ego.world.room_navigator
    target_mps = ego.civilian_driver.pull_over.creep_mps if close else ego.world.speeds.civilian_pull_over_mps
    navigator, command, _ = navigate(unit, ego, target_mps, config)
    return YieldStep(changed(unit, navigator=navigator), command)
