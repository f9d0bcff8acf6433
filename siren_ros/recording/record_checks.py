"""Checks the messages of a record before they are used, because a bag may come from an untrusted source."""

import math
from collections.abc import Collection, Sequence
from dataclasses import replace
from typing import Final

from siren_ros.errors import BagError
from siren_ros.interfaces.lockstep_reports import EpisodeClosing
from siren_ros.scenario.episode import EpisodeDescription, EpisodeEnd, EpisodeOutcome
from siren_ros.world.actors import ACTOR_STATE_DTYPES, ActorStates
from siren_ros.world.commands import COMMAND_DTYPES, VehicleCommands
from siren_ros.world.traffic_state import TRAFFIC_STATE_DTYPES, TrafficState

LAST_STEP: Final = 2**31
"""Three years of simulated time."""
LONGEST_S: Final = 1e8
_OF_OTHER_LENGTH: Final = frozenset({"removed", "route_offset", "route_edges"})
_TRAFFIC_COLUMNS: Final = tuple(name for name in TRAFFIC_STATE_DTYPES if name not in _OF_OTHER_LENGTH)


def check_states(states: ActorStates) -> None:
    """Raises BagError unless all columns have one length and the step is in range."""
    _check(states, ACTOR_STATE_DTYPES)


def check_traffic(traffic: TrafficState) -> None:
    """As ``check_states``; the routes must also lie within their list."""
    _check(traffic, _TRAFFIC_COLUMNS)
    ends = traffic.route_offset
    bounded = len(ends) == 0 or (ends[0] >= 0 and ends[-1] <= len(traffic.route_edges))
    if len(ends) not in {0, len(traffic.actor_id) + 1} or not bounded or (ends[1:] < ends[:-1]).any():
        raise BagError(f"TrafficState of step {traffic.step}", "routes that lie within route_edges")


def check_commands(commands: VehicleCommands) -> None:
    """As ``check_states``."""
    _check(commands, COMMAND_DTYPES)


def check_description(description: EpisodeDescription) -> None:
    """Raises BagError unless the duration is finite, not negative and at most ``LONGEST_S``."""
    if not (math.isfinite(description.duration_s) and 0.0 <= description.duration_s <= LONGEST_S):
        raise BagError(f"duration_s {description.duration_s}", f"a number from 0 to {LONGEST_S:g}")


def outcome_of_what_is_held(
    outcome: EpisodeOutcome | None, closing: EpisodeClosing | None, steps: Sequence[int]
) -> EpisodeOutcome | None:
    """The recorded outcome; for a bag without every step that was closed, a failure that says so.

    Args:
        outcome: As recorded; None where the bag has none.
        closing: Its ``EpisodeEnd``, likewise.
        steps: Numbers of the steps whose actor states the bag holds, in its order.
    """
    if outcome is None or outcome.end is not EpisodeEnd.COMPLETE:
        return outcome
    closed = outcome.steps if closing is None else max(outcome.steps, closing.steps)
    if list(steps) == list(range(closed)):
        return outcome
    held = len({step for step in steps if step < closed})
    reason = f"the bag holds {held} of the {closed} steps that were closed"
    if held == closed:
        reason = f"the bag holds more than the {closed} steps that were closed"
    return replace(outcome, end=EpisodeEnd.FAILED, reason=reason, predicate_holds=None)


def _check(columns: ActorStates | TrafficState | VehicleCommands, names: Collection[str]) -> None:
    what = f"{type(columns).__name__} of step {columns.step}"
    if not 0 <= columns.step < LAST_STEP:
        raise BagError(what, f"steps from 0 to {LAST_STEP - 1}")
    if len({len(getattr(columns, name)) for name in names}) > 1:
        raise BagError(what, "columns of one length")
