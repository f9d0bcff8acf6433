"""L2: the feasible-yield lane change out of the EMV's lane (paper, Algorithm 2, ``npc_behavior_lvl = 1``).

A driver who finds no gap makes one, by falling back or drawing ahead in the present lane.
"""

from dataclasses import replace
from enum import IntEnum
from typing import Final

from siren_ros.behaviour.civilians.rejoin import rejoin
from siren_ros.behaviour.civilians.unit import (
    EmvView,
    YieldStep,
    YieldUnit,
    lane_of,
    release_reason,
    standing,
    yield_event,
)
from siren_ros.behaviour.config import YieldConfig
from siren_ros.behaviour.driving.lane_change import (
    LaneChangeQuery,
    LaneGaps,
    Refusal,
    assess,
    entered_lane,
    gaps_in_lane,
    lane_change_path,
    refusal_of_gaps,
)
from siren_ros.behaviour.driving.navigator import DriveInputs, NavigatorState, navigate
from siren_ros.behaviour.driving.step_view import StepView
from siren_ros.behaviour.paths.lane_path import (
    LaneEnd,
    LanePath,
    lanes_along,
    nearest_on_lane,
    neighbour_lane,
    path_on_lanes,
)
from siren_ros.behaviour.paths.tracked_path import on_reference
from siren_ros.numerics.units import steps_from_s
from siren_ros.roads.movements import road_lane_of
from siren_ros.roads.road_network import NO_LANE
from siren_ros.world.actors import Mode
from siren_ros.world.traffic_state import Event, EventKind, TrafficFlags

GAP_REFUSALS: Final = frozenset({Refusal.BESIDE, Refusal.GAP_FRONT, Refusal.GAP_REAR})
_AHEAD_M: Final = 80.0


class Seek(IntEnum):
    """How a gap is sought."""

    FALL_BACK = -1
    NOT = 0
    DRAW_AHEAD = 1


def seek_gap(unit: YieldUnit, view: StepView, row: int, refusal: Refusal) -> YieldStep:
    """One step of a deferred vehicle in its own lane, towards a gap in the lane next to it.

    The vehicle must still be able to stop and change lanes before the next junction; elsewhere SUMO keeps driving.

    Args:
        unit: A deferred civilian whose ``side`` says where it wants to go.
        view: The step.
        row: Its row.
        refusal: Why the lane change is not feasible now.
    """
    unit = _with_path(unit, view, row)
    config = view.world.config
    speed = float(view.seen.speed_mps[row])
    stop = speed * speed / (2.0 * config.civilian_navigator.comfort_brake_mps2)
    if unit.navigator.remaining_m < max(stop, config.yielding.seek_room_m):
        return YieldStep(replace(unit, navigator=NavigatorState(), seek=Seek.NOT))
    lane = lane_of(unit, view, row)
    target = neighbour_lane(view.world.network, lane, unit.side)
    if target == NO_LANE:
        return YieldStep(replace(unit, navigator=NavigatorState(), seek=Seek.NOT))
    gaps = gaps_in_lane(view, row, target)
    limit = view.world.network.lanes[lane].speed_limit_mps
    again = (view.step - unit.deferred_step) % steps_from_s(config.yielding.seek_again_s) == 0
    if unit.seek == Seek.NOT or again:
        seek = choose_seek(gaps, gaps_in_lane(view, row, lane), refusal, config.yielding, limit)
        unit = replace(unit, seek=seek, deferred=refusal.value)
    wanted = seek_speed_mps(Seek(unit.seek), gaps, config.yielding, limit)
    situation = DriveInputs(view.seen, row, view.vehicle(row), wanted)
    navigator, command, _ = navigate(unit.navigator, situation, config.civilian_navigator)
    return YieldStep(replace(unit, navigator=navigator), command)


def choose_seek(gaps: LaneGaps, own: LaneGaps, refusal: Refusal, config: YieldConfig, limit_mps: float) -> Seek:
    """Whether to fall back or to draw ahead.

    The driver draws ahead of a vehicle that is behind, or alongside and further back, if the own lane is free and the
    speed limit lets the driver gain on that vehicle. In all other cases the driver falls back and lets the others pass.

    Args:
        gaps: In the adjacent lane.
        own: In the own lane.
        refusal: Why the gap cannot be entered.
        config: Free way and gain of speed that drawing ahead needs.
        limit_mps: Speed limit.
    """
    behind = refusal is Refusal.GAP_REAR or (refusal is Refusal.BESIDE and gaps.front_m > 0.0)
    gains = limit_mps - gaps.rear_mps >= config.seek_gain_mps
    return Seek.DRAW_AHEAD if behind and gains and own.front_m > config.seek_free_m else Seek.FALL_BACK


def seek_speed_mps(seek: Seek, gaps: LaneGaps, config: YieldConfig, limit_mps: float) -> float:
    """Speed while seeking: faster or slower than the vehicle in the way, between a least speed and the limit."""
    other = gaps.front_mps if gaps.front_m < gaps.rear_m else gaps.rear_mps
    if seek is Seek.DRAW_AHEAD:
        return min(other + config.seek_speed_mps, limit_mps)
    return min(max(other - config.seek_speed_mps, config.seek_least_mps), limit_mps)


def soon_free(seek: Seek, gaps: LaneGaps, speed_mps: float, margin_m: float, soon_s: float) -> bool:
    """Whether the driver has left the vehicle in the way behind, or let it pass, within a time at the present speeds.

    Args:
        seek: How the gap is sought.
        gaps: In the adjacent lane.
        speed_mps: Of the driver.
        margin_m: Free way that is needed to that vehicle.
        soon_s: The time.
    """
    if seek is Seek.FALL_BACK:
        gap, gain, others = gaps.front_m, gaps.front_mps - speed_mps, gaps.rear_m
    else:
        gap, gain, others = gaps.rear_m, speed_mps - gaps.rear_mps, gaps.front_m
    return seek is not Seek.NOT and gap < margin_m <= gap + soon_s * gain and others > 0.0


def _with_path(unit: YieldUnit, view: StepView, row: int) -> YieldUnit:
    if unit.navigator.path is not None:
        return unit
    world, lane = view.world, int(view.traffic.lane[row])
    if road_lane_of(world.network, lane) == NO_LANE:
        return unit
    x, y, _ = view.pose(row)
    position = nearest_on_lane(world.network.lanes[lane].centre, x, y)[0]
    route = view.traffic.route_of_row(row)
    lanes, end = lanes_along(world.network, lane, position, route, _AHEAD_M, civilian=True, through_junctions=False)
    reference = path_on_lanes(world.network, lanes, end, position - 2.0, _AHEAD_M)
    shorten = float(view.seen.half_length_m[row]) + 1.0
    path = on_reference(reference, view.navigator_config(row), stop_at_end=True, shorten_m=shorten)
    return replace(unit, navigator=NavigatorState().following(path, x, y))


_RIGHT_FIRST = (-1, 1)
_GOES_ON_MPS = 1.0
"""Who is faster goes on with the lane change: a stop half-way would take both lanes."""
_FOLLOWED_STEPS = steps_from_s(1.0)


def start_lane_change(unit: YieldUnit, view: StepView, row: int) -> YieldStep:
    """Starts the lane change if it is feasible, and defers the yield if it is not.

    Of the feasible sides, one on which the vehicle can follow its route is preferred, then the side that SUMO's
    lane-change model wants (the paper's intent), then the right side. A deferred request is reconsidered at every
    step, once the cooldown since the vehicle's last forced lane change is over.
    """
    if view.step - unit.change_step < view.world.cooldown_steps:
        return defer(unit, view, row, "cooldown")
    lane = lane_of(unit, view, row)
    route = view.traffic.route_of_row(row)
    speed = yield_speed_mps(view, lane)
    wanted = intent_of(view, row)
    refusals: list[tuple[int, Refusal]] = []
    choices: list[tuple[tuple[bool, bool], LaneChangeQuery, LanePath]] = []
    for side in _RIGHT_FIRST:
        query = LaneChangeQuery(row, lane, side, speed, route, civilian=True)
        verdict = assess(view, query)
        if isinstance(verdict, Refusal):
            refusals.append((side, verdict))
        else:
            choices.append(((verdict.end is LaneEnd.ASTRAY, side != wanted), query, verdict))
    if not choices:
        return _wait_for_gap(unit, view, row, refusals)
    _, query, reference = min(choices, key=lambda choice: choice[0])
    path = lane_change_path(view, query, reference, stop_at_end=True)
    x, y, _ = view.pose(row)
    target = neighbour_lane(view.world.network, lane, query.side)
    unit = replace(
        unit,
        phase=Mode.YIELD_LANE_CHANGE,
        side=query.side,
        change_step=view.step,
        deferred="",
        seek=0,
        navigator=NavigatorState().following(path, x, y),
    )
    started = yield_event(unit, view, row, EventKind.YIELD_STARTED, side=query.side, from_lane=lane, to_lane=target)
    moved = drive(unit, view, row, speed)
    return replace(moved, events=(started, *moved.events))


def intent_of(view: StepView, row: int) -> int:
    """Side to which SUMO's lane-change model wants to take a vehicle: +1 left, −1 right, 0 neither."""
    flags = int(view.traffic.flags[row])
    return bool(flags & TrafficFlags.WANTS_LEFT) - bool(flags & TrafficFlags.WANTS_RIGHT)


def yield_speed_mps(view: StepView, lane: int) -> float:
    """Target speed of the lane change: the paper's, and at most the paper's share of the speed limit."""
    speeds = view.world.speeds
    if lane == NO_LANE:
        return speeds.civilian_yield_lane_change_mps
    slowed = (1.0 - speeds.civilian_yield_speed_difference) * view.world.network.lanes[lane].speed_limit_mps
    return min(speeds.civilian_yield_lane_change_mps, slowed)


def defer(unit: YieldUnit, view: StepView, row: int, reason: str) -> YieldStep:
    """The yield waits. The event is recorded where the wait begins."""
    events: tuple[Event, ...] = ()
    if unit.phase is not Mode.YIELD_DEFERRED:
        events = (yield_event(unit, view, row, EventKind.YIELD_DEFERRED, reason=reason),)
        unit = replace(unit, deferred_step=view.step)
    waiting = replace(
        unit, phase=Mode.YIELD_DEFERRED, deferred=reason, navigator=NavigatorState(), seek=0, side=unit.side
    )
    return YieldStep(waiting, None, events)


def _wait_for_gap(unit: YieldUnit, view: StepView, row: int, refusals: list[tuple[int, Refusal]]) -> YieldStep:
    """Defers the yield. After a while the driver makes a gap, if only other vehicles are in the way.

    The driver tries for some seconds, and longer while the gap is nearly there. Then the driver goes on under SUMO at
    the pace of the road, and tries again later.
    """
    in_the_way = [(side, refusal) for side, refusal in refusals if refusal in GAP_REFUSALS]
    if not in_the_way:
        telling = (refusal for _, refusal in refusals if refusal is not Refusal.NO_LANE)
        return defer(unit, view, row, next(telling, Refusal.NO_LANE).value)
    side, refusal = next(((s, r) for s, r in in_the_way if s == unit.side), in_the_way[0])
    if unit.phase is not Mode.YIELD_DEFERRED:
        return defer(replace(unit, side=side), view, row, refusal.value)
    config = view.world.config.yielding
    waited = view.step - unit.deferred_step - steps_from_s(config.seek_after_s)
    seeks, pauses = steps_from_s(config.seek_for_s), steps_from_s(config.seek_pause_s)
    if waited < 0 or (waited % (seeks + pauses) >= seeks and not _has_it_soon(unit, view, row, side)):
        return YieldStep(replace(unit, side=side, deferred=refusal.value, navigator=NavigatorState(), seek=0))
    return seek_gap(replace(unit, side=side), view, row, refusal)


def _has_it_soon(unit: YieldUnit, view: StepView, row: int, side: int) -> bool:
    target = neighbour_lane(view.world.network, lane_of(unit, view, row), side)
    if unit.seek == Seek.NOT or target == NO_LANE:
        return False
    gaps, config = gaps_in_lane(view, row, target), view.world.config
    margin = (
        config.civilian_lane_change.front_gap_m
        if unit.seek == Seek.FALL_BACK
        else config.civilian_lane_change.rear_gap_m
    )
    return soon_free(Seek(unit.seek), gaps, float(view.seen.speed_mps[row]), margin, config.yielding.seek_soon_s)


def drive(unit: YieldUnit, view: StepView, row: int, target_mps: float) -> YieldStep:
    """One step along the planner's path."""
    situation = DriveInputs(view.seen, row, view.vehicle(row), target_mps)
    navigator, command, _ = navigate(unit.navigator, situation, view.world.config.civilian_navigator)
    return YieldStep(replace(unit, navigator=navigator), command)


def change_lane(unit: YieldUnit, view: StepView, row: int, emv: EmvView) -> YieldStep:
    """Drives the lane change until the vehicle is wholly in its new lane, or is released."""
    lane = lane_of(unit, view, row)
    if entered_lane(view, row, lane):
        done = yield_event(unit, view, row, EventKind.YIELD_COMPLETED, lane=lane)
        kept = replace(unit, phase=Mode.YIELD_KEEP_LANE, navigator=NavigatorState(), off_path_steps=0)
        return YieldStep(kept, None, (done,))
    ended = unit.navigator.done and standing(view, row)
    if release_reason(emv) or ended:
        reason = "lane_ended" if ended and not emv.passed else release_reason(emv)
        cancelled = yield_event(unit, view, row, EventKind.YIELD_CANCELLED, reason=reason)
        moved = rejoin(replace(unit, phase=Mode.REJOIN, stopped_steps=0), view, row)
        return replace(moved, events=(cancelled, *moved.events))
    return drive(unit, view, row, 0.0 if _others_come(view, row, lane) else yield_speed_mps(view, lane))


def _others_come(view: StepView, row: int, lane: int) -> bool:
    """Whether a driver who had to stop on the way into a lane has to let others in it pass before going on."""
    speed = float(view.seen.speed_mps[row])
    if speed > _GOES_ON_MPS or int(view.traffic.lane[row]) == lane:
        return False
    gaps = gaps_in_lane(view, row, lane)
    refusal = refusal_of_gaps(gaps, speed, speed, view.world.config.civilian_lane_change)
    return refusal in {Refusal.GAP_REAR, Refusal.BESIDE}


def keep_lane(unit: YieldUnit, view: StepView, row: int, emv: EmvView) -> YieldStep:
    """Stays in the new lane under SUMO until it is released. Yields again if the EMV follows into that lane."""
    if release_reason(emv) or _strayed(unit, emv, view):
        reason = release_reason(emv) or "emv_gone"
        return YieldStep(None, None, (yield_event(unit, view, row, EventKind.YIELD_RELEASED, reason=reason),))
    followed = unit.in_lane_steps + 1 if emv.on_path else 0
    unit = replace(unit, in_lane_steps=followed, off_path_steps=0 if emv.on_road else unit.off_path_steps + 1)
    if followed < _FOLLOWED_STEPS:
        return YieldStep(unit)
    asked = yield_event(unit, view, row, EventKind.YIELD_REQUESTED, reason="emv_followed")
    again = replace(unit, phase=Mode.YIELD_REACTING, react_step=view.step, in_lane_steps=0, off_path_steps=0)
    return YieldStep(again, None, (asked,))


def _strayed(unit: YieldUnit, emv: EmvView, view: StepView) -> bool:
    grace = steps_from_s(view.world.config.yielding.off_path_grace_s)
    return not emv.on_road and unit.off_path_steps >= grace
