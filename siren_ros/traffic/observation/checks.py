"""Checks of every step between SUMO and the simulated world. An episode that breaks one fails."""

from typing import Final

import numpy as np

from siren_ros.errors import EpisodeError
from siren_ros.world.actors import ActorStates
from siren_ros.world.events import EventKind
from siren_ros.world.traffic_state import TrafficState

RESIDUAL_LIMIT_M: Final = 20.0
"""A simulated vehicle this far from its pose in SUMO should have been brought back to it long before."""


def check_residual(states: ActorStates, limit_m: float = RESIDUAL_LIMIT_M) -> None:
    """Fail where the two worlds have drifted apart.

    Raises:
        EpisodeError: Names the actor, the residual and the limit.
    """
    if len(states) == 0:
        return
    row = int(np.argmax(states.residual_m))
    residual_m = float(states.residual_m[row])
    if residual_m > limit_m:
        raise EpisodeError(
            f"actor {states.actor_id[row]} is {residual_m:.2f} m from its pose in SUMO at step {states.step}; "
            f"the limit is {limit_m:g} m"
        )


def check_no_teleport(traffic: TrafficState) -> None:
    """Fail where SUMO has moved a vehicle in a way that no vehicle moves.

    Raises:
        EpisodeError: Names the actor, the step and what SUMO said.
    """
    for event in traffic.events:
        if event.kind is EventKind.TELEPORT:
            reason = event.detail.get("reason", "")
            raise EpisodeError(f"SUMO teleported actor {event.actor_id} at step {event.step} ({reason})")
