"""The distance between SUMO's and the simulated pose of an actor: measured always, bounded loudly."""

import numpy as np

from siren_ros.world.actors import ActorStates
from siren_ros.world.errors import EpisodeError


def check_residual(states: ActorStates, limit_m: float) -> None:
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
