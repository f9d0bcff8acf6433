"""The head of a jam: the foremost vehicle of each lane stands, or stops and goes, whatever is ahead of it."""

import math
from dataclasses import dataclass

from siren_ros.base.numerics.units import STEP_S


@dataclass(frozen=True)
class JamHead:
    """Which vehicles the cause of a jam holds up, and how they go on behind it."""

    names: tuple[str, ...]
    moves: bool
    """Whether they go on after their first stop."""
    roll_s: float
    """Time for which they roll, from step 0 on…"""
    roll_mps: float
    stand_s: float
    """…and then stand, in turn."""
    until_s: float = math.inf
    """When the cause of the jam is gone."""

    def speed_mps(self, step: int) -> float:
        """The speed that they wish for at a step; −1, SUMO's word for no order, once the cause is gone."""
        time_s = step * STEP_S
        if time_s >= self.until_s:
            return -1.0
        into_s = time_s % (self.roll_s + self.stand_s) if self.moves else time_s
        return self.roll_mps if into_s < self.roll_s else 0.0
