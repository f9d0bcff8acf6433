"""Explains the guards of the paper's algorithms at one step: which act, and why the others do not."""

from typing import Final, NamedTuple

from siren_ros.base.numerics.units import STEP_S
from siren_ros.simulation.behaviour.driving.civilian_unit import Compliance, YieldUnit
from siren_ros.simulation.behaviour.driving.emv_unit import EmvUnit
from siren_ros.simulation.behaviour.driving.step_view import BehaviourWorld
from siren_ros.simulation.scenario.paper import CivilianResponse
from siren_ros.simulation.world.actors import NO_ACTOR, Mode


class GuardState(NamedTuple):
    """Result of one guard at a step."""

    name: str
    acts: bool
    why: str


_ONLY_L3: Final = "this level has no rescue corridor"


def emv_guards(unit: EmvUnit, step: int, world: BehaviourWorld) -> tuple[GuardState, ...]:
    """The guards of Algorithm 1, from top to bottom."""
    source = "gap escape" if unit.gap_escape_active else "rescue corridor" if unit.corridor else "route"
    return (
        GuardState("gap escape", unit.gap_escape_active, _of_escape(unit, world)),
        GuardState("rescue corridor", unit.corridor, _of_corridor(unit, step, world)),
        GuardState("forced lane change", unit.lane_change_forced, _of_lane_change(unit, step, world)),
        GuardState("waypoints", True, f"the path comes from the {source}"),
    )


def _of_escape(unit: EmvUnit, world: BehaviourWorld) -> str:
    constants = world.constants.gap_escape
    if not (world.policy.corridor or unit.between or unit.lane_change_forced):
        return "at this level only from a lane change that stands still"
    if unit.gap_escape_active:
        free = f"{unit.blocker_free_s:.1f} of {constants.blocker_grace_s:g} s free"
        return "no free path yet" if unit.escape_offset_m is None else f"drives past the blocker; {free}"
    if unit.blocker_free_s > 0.0:
        return "nobody blocks the way"
    return f"stands for {unit.stopped_s:.1f} s, enters after {constants.stop_before_entry_s:g} s"


def _of_corridor(unit: EmvUnit, step: int, world: BehaviourWorld) -> str:
    if not world.policy.corridor:
        return _ONLY_L3
    if not unit.corridor:
        return "nobody ahead forms a rescue lane or brakes for the EMV"
    since_s = (step - unit.corridor_seen_step) * STEP_S
    return "vehicles ahead make way" if since_s == 0.0 else f"none has made way for {since_s:.1f} s"


def _of_lane_change(unit: EmvUnit, step: int, world: BehaviourWorld) -> str:
    request, cooldown_s = unit.request, (world.cooldown_steps - step + unit.change_step) * STEP_S
    if unit.between:
        return "not between other vehicles"
    if unit.lane_change_forced:
        return f"to the {_side(unit.change_side)}"
    if request.side == 0:
        return "neither route nor traffic ask for one"
    asked = f"asked for to the {_side(request.side)} ({_words(request.reason)})"
    if request.deferred is not None:
        return f"{asked}, deferred: {_words(request.deferred.value)}"
    return f"{asked}, not before {cooldown_s:.1f} s" if cooldown_s > 0.0 else asked


_DONE: Final = {Mode.YIELD_KEEP_LANE, Mode.YIELD_HOLD, Mode.REJOIN}
_UNDER_WAY: Final = {Mode.YIELD_LANE_CHANGE: "the lane change", Mode.YIELD_PULL_OVER: "the pull-over"}


def civilian_guards(unit: YieldUnit, step: int, world: BehaviourWorld) -> tuple[GuardState, ...]:
    """The guards of Algorithm 2 in the order in which a yield passes them."""
    complies, left_s = unit.driver.compliance is not Compliance.NEVER, (unit.react_step - step) * STEP_S
    pulls_over = world.policy.response is CivilianResponse.PULL_OVER
    heard = f"heard the EMV within {unit.driver.response_distance_m:.0f} m"
    reacts = "this driver does not comply" if not complies else f"{unit.driver.compliance.value}, "
    if complies:
        reacts += f"in {left_s:.1f} s" if left_s > 0.0 else f"{-left_s:.1f} s ago"
    return (
        GuardState("notices", True, f"{heard}: EMV {unit.emv_id}" if unit.emv_id != NO_ACTOR else heard),
        GuardState("reacts", complies and left_s <= 0.0, reacts),
        GuardState("pulls over" if pulls_over else "changes lane", unit.phase in _UNDER_WAY, _of_manoeuvre(unit)),
        GuardState("holds" if pulls_over else "keeps its lane", unit.phase in _DONE - {Mode.REJOIN}, _of_end(unit)),
        GuardState("rejoins", unit.phase is Mode.REJOIN, "once the EMV has passed, or is gone"),
    )


def _of_manoeuvre(unit: YieldUnit) -> str:
    if unit.phase in _UNDER_WAY:
        return f"to the {_side(unit.side)}"
    if unit.deferred:
        return f"deferred: {_words(unit.deferred)}"
    return "done" if unit.phase in _DONE else "not begun"


def _of_end(unit: YieldUnit) -> str:
    under_way = _UNDER_WAY.get(unit.phase)
    if under_way:
        return f"{under_way} is not finished"
    return "until the EMV has passed" if unit.phase in _DONE else "not begun"


def _side(side: int) -> str:
    return "left" if side > 0 else "right"


def _words(name: str) -> str:
    return name.replace("_", " ")
