"""L2: the feasible-yield lane change out of the EMV's lane (paper, Algorithm 2, ``npc_behavior_lvl = 1``)."""

from dataclasses import replace

from siren_ros.behaviour.lane_change import (
    LaneChangeQuery,
    Refusal,
    assess,
    entered_lane,
    lane_change_path,
)
from siren_ros.behaviour.lane_path import LaneEnd, LanePath, neighbour_lane
from siren_ros.behaviour.navigator import NavigatorState, Situation, navigate
from siren_ros.behaviour.rejoin import rejoin
from siren_ros.behaviour.world import StepView
from siren_ros.behaviour.yield_unit import EmvView, Outcome, YieldUnit, lane_of, standing, yield_event
from siren_ros.world.actors import Mode
from siren_ros.world.events import Event, EventKind
from siren_ros.world.units import steps_from_s

_RIGHT_FIRST = (-1, 1)
_FOLLOWED_STEPS = steps_from_s(1.0)


def start_lane_change(unit: YieldUnit, row: int, view: StepView) -> Outcome:
    """Starts the lane change where it is feasible, and defers the yield where it is not.

    Sides on which the vehicle can go on along its route come first, the right side before the left one. The
    request is looked at again at every step, after the cooldown since the vehicle's last forced lane change.
    """
    if view.step - unit.change_step < view.world.cooldown_steps:
        return defer(unit, row, view, "cooldown")
    config = view.world.config
    lane = int(view.traffic.lane[row])
    route = view.traffic.route_of_row(row)
    speed = view.world.speeds.civilian_yield_lane_change_mps
    refusals: list[Refusal] = []
    choices: list[tuple[bool, LaneChangeQuery, LanePath]] = []
    for side in _RIGHT_FIRST:
        query = LaneChangeQuery(row, lane, side, speed, route, civilian=True)
        verdict = assess(view, query)
        if isinstance(verdict, Refusal):
            refusals.append(verdict)
        else:
            choices.append((verdict.end is LaneEnd.ASTRAY, query, verdict))
    if not choices:
        telling = [refusal for refusal in refusals if refusal is not Refusal.NO_LANE]
        return defer(unit, row, view, (telling or refusals)[0].value)
    _, query, reference = min(choices, key=lambda choice: choice[0])
    path = lane_change_path(view, query, reference, config.civilian_navigator, stop_at_end=True)
    x, y, _ = view.pose(row)
    target = neighbour_lane(view.world.network, lane, query.side)
    unit = replace(
        unit,
        phase=Mode.YIELD_LANE_CHANGE,
        side=query.side,
        change_step=view.step,
        deferred="",
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
    return Outcome(replace(unit, phase=Mode.YIELD_DEFERRED, deferred=reason), None, events)


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
