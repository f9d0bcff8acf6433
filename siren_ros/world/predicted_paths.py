"""What a predictor says at a step."""

from dataclasses import dataclass

from siren_ros.numerics.arrays import Floats, Ids


@dataclass(frozen=True)
class PredictedPaths:
    """R paths of vehicles, several for each, in the ``map`` frame."""

    step: int
    """The present."""
    actor_id: Ids
    """Shape ``(R,)``."""
    probability: Floats
    """Of each path; those of a vehicle sum to 1."""
    xy_m: Floats
    """Centres of the footprint, shape ``(R, L, 2)``."""

    def __len__(self) -> int:
        return len(self.actor_id)
