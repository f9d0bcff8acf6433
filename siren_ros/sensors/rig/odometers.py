"""How far the vehicles have driven, so that their wheels turn in pictures."""

import numpy as np

from siren_ros.numerics.arrays import Floats
from siren_ros.numerics.units import STEP_S
from siren_ros.world.actors import ActorStates, rows_of_ids


class Odometers:
    """How far every actor has driven, so that wheels turn."""

    def __init__(self) -> None:
        self._step: int | None = None
        self._ids = np.empty(0, np.uint32)
        self._rolled_m = np.empty(0, np.float64)

    def advance(self, states: ActorStates) -> Floats:
        """Distance rolled by each row of the states, counted from when the actor was first seen."""
        rows = rows_of_ids(self._ids, states.actor_id)
        rolled = np.where(rows >= 0, self._rolled_m[rows], 0.0) if len(self._ids) else np.zeros(len(states))
        elapsed_s = 0.0 if self._step is None else (states.step - self._step) * STEP_S
        forward = states.vx_mps * np.cos(states.yaw_rad) + states.vy_mps * np.sin(states.yaw_rad)
        rolled = rolled + forward * elapsed_s
        self._step, self._ids, self._rolled_m = states.step, states.actor_id, rolled
        return rolled
