"""L2: the feasible-yield lane change out of the EMV's lane (paper, Algorithm 2, ``npc_behavior_lvl = 1``)."""

from dataclasses import replace

from siren_ros.behaviour.civilians.gap_seeking import GAP_REFUSALS, seek_gap
from siren_ros.behaviour.civilians.rejoin import rejoin
from siren_ros.behaviour.civilians.unit import EmvView, Outcome, YieldUnit, lane_of, standing, yield_event
from siren_ros.behaviour.driving.lane_change import (
    LaneChangeQuery,
    Refusal,
    assess,
    entered_lane,
    lane_change_path,
)
from siren_ros.behaviour.driving.navigator import NavigatorState, Situation, navigate
from siren_ros.behaviour.driving.situation import StepView
from siren_ros.behaviour.paths.lane_path import LaneEnd, LanePath, neighbour_lane
from siren_ros.numerics.units import steps_from_s
from siren_ros.world.actors import Mode
from siren_ros.world.events import Event, EventKind

_RIGHT_FIRST = (-1, 1)
_FOLLOWED_STEPS = steps_from_s(1.0)


def start_lane_change(unit: YieldUnit, row: int, view: StepView) -> Outcome:
    """Starts the lane change where it is feasible, and defers the yield where it is not.

    Sides on which the vehicle can go on along its route come first, the right side before the left one. The
    request is looked at again at every step, after the cooldown since the vehicle's last forced lane change.
    """
    if view.step - unit.change_step < view.world.cooldown_steps:
        return defer(unit, row, view, "cooldown")
    lane = lane_of(unit, row, view)
    route = view.traffic.route_of_row(row)
    speed = view.world.speeds.civilian_yield_lane_change_mps
    refusals: list[tuple[int, Refusal]] = []
    choices: list[tuple[bool, LaneChangeQuery, LanePath]] = []
    for side in _RIGHT_FIRST:
        query = LaneChangeQuery(row, lane, side, speed, route, civilian=True)
        verdict = assess(view, query)
        if isinstance(verdict, Refusal):
            refusals.append((side, verdict))
        else:
            choices.append((verdict.end is LaneEnd.ASTRAY, query, verdict))
    if not choices:
        return _wait_for_gap(unit, row, view, refusals)
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
    started = yield_event(unit, row, view, EventKind.YIELD_STARTED, side=query.side, from_lane=lane, to_lane=target)
    moved = drive(unit, row, view, speed)
    return replace(moved, events=(started, *moved.events))


def defer(unit: YieldUnit, row: int, view: StepView, reason: str) -> Outcome:
    """The yield waits; the event is recorded once per spell."""
    events: tuple[Event, ...] = ()
    if unit.phase is not Mode.YIELD_DEFERRED:
        events = (yield_event(unit, row, view, EventKind.YIELD_DEFERRED, reason=reason),)
        unit = replace(unit, deferred_step=view.step)
    waiting = replace(
        unit, phase=Mode.YIELD_DEFERRED, deferred=reason, navigator=NavigatorState(), seek=0, side=unit.side
    )
    return Outcome(waiting, None, events)


def _wait_for_gap(unit: YieldUnit, row: int, view: StepView, refusals: list[tuple[int, Refusal]]) -> Outcome:
    """Defers, and after a while makes a gap where only the other vehicles are in the way."""
    in_the_way = [(side, refusal) for side, refusal in refusals if refusal in GAP_REFUSALS]
    if not in_the_way:
        telling = (refusal for _, refusal in refusals if refusal is not Refusal.NO_LANE)
        return defer(unit, row, view, next(telling, Refusal.NO_LANE).value)
    side, refusal = next(((s, r) for s, r in in_the_way if s == unit.side), in_the_way[0])
    if unit.phase is not Mode.YIELD_DEFERRED:
        return defer(replace(unit, side=side), row, view, refusal.value)
    if view.step - unit.deferred_step < steps_from_s(view.world.config.yielding.seek_after_s):
        return Outcome(replace(unit, side=side, deferred=refusal.value))
    return seek_gap(replace(unit, side=side), row, view, refusal)


def drive(unit: YieldUnit, row: int, view: StepView, target_mps: float) -> Outcome:
    """One step along the planner's path."""
    situation = Situation(view.seen, row, view.vehicle(row), target_mps)
    navigator, command, _ = navigate(unit.navigator, situation, view.world.config.civilian_navigator)
    return Outcome(replace(unit, navigator=navigator), command)


def change_lane(unit: YieldUnit, row: int, view: StepView, emv: EmvView) -> Outcome:
    """Drives the lane change until the vehicle is wholly in its new lane, or the EMV is past or gone."""
    lane = lane_of(unit, row, view)
    if entered_lane(view, row, lane):
        done = yield_event(unit, row, view, EventKind.YIELD_COMPLETED, lane=lane)
        kept = replace(unit, phase=Mode.YIELD_KEEP_LANE, navigator=NavigatorState(), off_path_steps=0)
        return Outcome(kept, None, (done,))
    ended = unit.navigator.done and standing(view, row)
    if emv.passed or not emv.in_region or ended:
        reason = "emv_passed" if emv.passed else "lane_ended" if ended else "emv_gone"
        cancelled = yield_event(unit, row, view, EventKind.YIELD_CANCELLED, reason=reason)
        moved = rejoin(replace(unit, phase=Mode.REJOIN, stopped_steps=0), row, view)
        return replace(moved, events=(cancelled, *moved.events))
    return drive(unit, row, view, view.world.speeds.civilian_yield_lane_change_mps)


def keep_lane(unit: YieldUnit, row: int, view: StepView, emv: EmvView) -> Outcome:
    """Waits in the new lane, driven by SUMO, until the EMV is past or gone; yields again where the EMV follows."""
    if emv.passed or not emv.in_region or _strayed(unit, emv, view):
        reason = "emv_passed" if emv.passed else "emv_gone"
        return Outcome(None, None, (yield_event(unit, row, view, EventKind.YIELD_RELEASED, reason=reason),))
    followed = unit.in_lane_steps + 1 if emv.on_path else 0
    unit = replace(unit, in_lane_steps=followed, off_path_steps=0 if emv.on_road else unit.off_path_steps + 1)
    if followed < _FOLLOWED_STEPS:
        return Outcome(unit)
    asked = yield_event(unit, row, view, EventKind.YIELD_REQUESTED, reason="emv_followed")
    again = replace(unit, phase=Mode.YIELD_REACTING, react_step=view.step, in_lane_steps=0, off_path_steps=0)
    return Outcome(again, None, (asked,))


def _strayed(unit: YieldUnit, emv: EmvView, view: StepView) -> bool:
    grace = steps_from_s(view.world.config.yielding.off_path_grace_s)
    return not emv.on_road and unit.off_path_steps >= grace
