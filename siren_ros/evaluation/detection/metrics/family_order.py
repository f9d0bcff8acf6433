"""How probable it is that families of templates are in the paper's order of rising mAP."""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from types import MappingProxyType
from typing import Final, Self

import numpy as np

from siren_ros.numerics.arrays import Floats

FAMILIES: Final[Mapping[str, tuple[str, ...]]] = MappingProxyType(
    {"clearance": ("S1", "S2"), "stop sign": ("S5", "S6"), "shoulder": ("S7",), "red light": ("S3", "S4")}
)
"""Templates of the paper's families, in its order of rising mAP."""


@dataclass(frozen=True)
class FamilyOrder:
    """Shares of values drawn about each family's mAP, as far from it as its episodes leave open."""

    steps: Mapping[str, float]
    """In which a family is below the next one, by ``clearance < stop sign`` and so on."""
    whole: float
    """In which all are in the paper's order at once; 1 in 24 by chance."""

    @classmethod
    def of(cls, families: Mapping[str, Floats]) -> Self | None:
        """From the mAP of each family in each draw, shape ``(R,)``; None where a family is missing."""
        if set(families) != set(FAMILIES):
            return None
        rises = {f"{low} < {high}": families[low] < families[high] for low, high in pairwise(FAMILIES)}
        steps = {name: float(rise.mean()) for name, rise in rises.items()}
        return cls(MappingProxyType(steps), float(np.all(list(rises.values()), axis=0).mean()))

    def told(self) -> str:
        """For a reader of the tables."""
        steps = ", ".join(f"{name} in {share:.0%}" for name, share in self.steps.items())
        return f"{steps} of the draws; the paper's whole order in {self.whole:.0%}, by chance 4%"
