"""The head of a jam: the foremost vehicle of each lane stands, or stops and goes, although the road ahead is free."""

import math
from dataclasses import dataclass

from siren_ros.base.numerics.units import STEP_S


@dataclass(frozen=True)
class JamHead:
    """How the cause of a jam holds up the foremost vehicles, and how they move."""

    names: tuple[str, ...]
    moves: bool
    """Whether the vehicles go on after their first stop."""
    roll_s: float
    """Time for which the vehicles roll, first from step 0 on."""
    roll_mps: float
    stand_s: float
    """Time for which they then stand; rolling and standing alternate."""
    until_s: float = math.inf
    """Time at which the cause of the jam ends."""

    def speed_mps(self, step: int) -> float:
        """The speed that is ordered at a step. −1 is SUMO's code for no order; it holds after the cause has ended."""
        time_s = step * STEP_S
        if time_s >= self.until_s:
            return -1.0
        into_s = time_s % (self.roll_s + self.stand_s) if self.moves else time_s
        return self.roll_mps if into_s < self.roll_s else 0.0
