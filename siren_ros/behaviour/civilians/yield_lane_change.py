"""L2: the feasible-yield lane change out of the EMV's lane (paper, Algorithm 2, ``npc_behavior_lvl = 1``)."""

from dataclasses import replace

from siren_ros.behaviour.civilians.gap_seeking import GAP_REFUSALS, Seek, seek_gap, soon_free
from siren_ros.behaviour.civilians.rejoin import rejoin
from siren_ros.behaviour.civilians.release import release_reason
from siren_ros.behaviour.civilians.unit import EmvView, Outcome, YieldUnit, lane_of, standing, yield_event
from siren_ros.behaviour.driving.lane_change import (
    LaneChangeQuery,
    Refusal,
    assess,
    entered_lane,
    gaps_in_lane,
    lane_change_path,
    refusal_of_gaps,
)
from siren_ros.behaviour.driving.navigator import NavigatorState, Situation, navigate
from siren_ros.behaviour.driving.situation import StepView
from siren_ros.behaviour.paths.lane_path import LaneEnd, LanePath, neighbour_lane
from siren_ros.numerics.units import steps_from_s
from siren_ros.roads.road_network import NO_LANE
from siren_ros.world.actors import Mode
from siren_ros.world.events import Event, EventKind
from siren_ros.world.traffic_state import TrafficFlags

_RIGHT_FIRST = (-1, 1)
_GOES_ON_MPS = 1.0
"""Who is faster goes on with the lane change: a stop half-way would take both lanes."""
_FOLLOWED_STEPS = steps_from_s(1.0)


def start_lane_change(unit: YieldUnit, view: StepView, row: int) -> Outcome:
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


def defer(unit: YieldUnit, view: StepView, row: int, reason: str) -> Outcome:
    """The yield waits. The event is recorded where the wait begins."""
    events: tuple[Event, ...] = ()
    if unit.phase is not Mode.YIELD_DEFERRED:
        events = (yield_event(unit, view, row, EventKind.YIELD_DEFERRED, reason=reason),)
        unit = replace(unit, deferred_step=view.step)
    waiting = replace(
        unit, phase=Mode.YIELD_DEFERRED, deferred=reason, navigator=NavigatorState(), seek=0, side=unit.side
    )
    return Outcome(waiting, None, events)


def _wait_for_gap(unit: YieldUnit, view: StepView, row: int, refusals: list[tuple[int, Refusal]]) -> Outcome:
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
        return Outcome(replace(unit, side=side, deferred=refusal.value, navigator=NavigatorState(), seek=0))
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


def drive(unit: YieldUnit, view: StepView, row: int, target_mps: float) -> Outcome:
    """One step along the planner's path."""
    situation = Situation(view.seen, row, view.vehicle(row), target_mps)
    navigator, command, _ = navigate(unit.navigator, situation, view.world.config.civilian_navigator)
    return Outcome(replace(unit, navigator=navigator), command)


def change_lane(unit: YieldUnit, view: StepView, row: int, emv: EmvView) -> Outcome:
    """Drives the lane change until the vehicle is wholly in its new lane, or is released."""
    lane = lane_of(unit, view, row)
    if entered_lane(view, row, lane):
        done = yield_event(unit, view, row, EventKind.YIELD_COMPLETED, lane=lane)
        kept = replace(unit, phase=Mode.YIELD_KEEP_LANE, navigator=NavigatorState(), off_path_steps=0)
        return Outcome(kept, None, (done,))
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


def keep_lane(unit: YieldUnit, view: StepView, row: int, emv: EmvView) -> Outcome:
    """Stays in the new lane under SUMO until it is released. Yields again if the EMV follows into that lane."""
    if release_reason(emv) or _strayed(unit, emv, view):
        reason = release_reason(emv) or "emv_gone"
        return Outcome(None, None, (yield_event(unit, view, row, EventKind.YIELD_RELEASED, reason=reason),))
    followed = unit.in_lane_steps + 1 if emv.on_path else 0
    unit = replace(unit, in_lane_steps=followed, off_path_steps=0 if emv.on_road else unit.off_path_steps + 1)
    if followed < _FOLLOWED_STEPS:
        return Outcome(unit)
    asked = yield_event(unit, view, row, EventKind.YIELD_REQUESTED, reason="emv_followed")
    again = replace(unit, phase=Mode.YIELD_REACTING, react_step=view.step, in_lane_steps=0, off_path_steps=0)
    return Outcome(again, None, (asked,))


def _strayed(unit: YieldUnit, emv: EmvView, view: StepView) -> bool:
    grace = steps_from_s(view.world.config.yielding.off_path_grace_s)
    return not emv.on_road and unit.off_path_steps >= grace
