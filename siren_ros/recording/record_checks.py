"""Checks the messages of a record before they are used, because a bag may come from an untrusted source."""

import math
from collections.abc import Collection
from typing import Final

from siren_ros.errors import BagError
from siren_ros.scenario.episode import EpisodeDescription
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


def _check(columns: ActorStates | TrafficState | VehicleCommands, names: Collection[str]) -> None:
    what = f"{type(columns).__name__} of step {columns.step}"
    if not 0 <= columns.step < LAST_STEP:
        raise BagError(what, f"steps from 0 to {LAST_STEP - 1}")
    if len({len(getattr(columns, name)) for name in names}) > 1:
        raise BagError(what, "columns of one length")
