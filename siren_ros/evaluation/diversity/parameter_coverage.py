"""How much of the ranges of a template's parameters a set of episodes has tried."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from siren_ros.evaluation.diversity.curves import expected_kinds
from siren_ros.numerics.arrays import Floats

PARTS: Final = 10
"""Equal parts of a range; a whole-number parameter with fewer values has a part for each."""


@dataclass(frozen=True)
class DrawnRange:
    """Between what a parameter is drawn."""

    low: float
    high: float
    whole: bool

    @property
    def parts(self) -> int:
        """Number of parts."""
        return min(PARTS, round(self.high - self.low) + 1) if self.whole else PARTS

    def part_of(self, values: Floats) -> Floats:
        """Part of each value, from 0; values outside count for the part at that end."""
        width = (self.high - self.low + (1.0 if self.whole else 0.0)) / self.parts
        return np.clip(np.floor((values - self.low) / width), 0, self.parts - 1)


@dataclass(frozen=True)
class ParameterCoverage:
    """The parts of one parameter's range."""

    path: str
    drawn: DrawnRange
    counts: tuple[int, ...]
    """Episodes in each part."""
    curve: Floats
    """Expected share of the parts that n episodes reach, n = 1 … N; shape ``(N,)``."""

    @property
    def share(self) -> float:
        """Share of the parts with an episode."""
        return sum(count > 0 for count in self.counts) / len(self.counts)


def parameter_coverage(
    episodes: Sequence[Mapping[str, float]], ranges: Mapping[str, DrawnRange]
) -> tuple[ParameterCoverage, ...]:
    """Coverage of every parameter that has a range and a value in all episodes, by path."""
    found = []
    for path, drawn in sorted(ranges.items()):
        if drawn.high <= drawn.low or not all(path in episode for episode in episodes):
            continue
        part = drawn.part_of(np.array([episode[path] for episode in episodes], dtype=np.float64)).astype(np.intp)
        counts = np.bincount(part, minlength=drawn.parts)
        reached = [int(count) for count in counts if count]
        found.append(
            ParameterCoverage(path, drawn, tuple(counts.tolist()), expected_kinds(reached, len(episodes)) / drawn.parts)
        )
    return tuple(found)
