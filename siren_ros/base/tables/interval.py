"""A value with its confidence interval, and the intervals of shares and of means of independent values."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

from scipy.special import ndtri

NONE: Final = "–"
"""Stands where there is no value."""
CONFIDENCE: Final = 0.95
BLOCKS_MIN: Final = 5
"""Fewest blocks of an interval. With fewer it is wider than the value, and holds too seldom where values are skewed."""


@dataclass(frozen=True)
class Interval:
    """An estimate from some blocks. Where it is not ``bounded``, ``low`` and ``high`` mean nothing."""

    value: float
    low: float
    high: float
    blocks: int
    """Number of independent blocks (episodes) behind it."""
    scatter_known: bool = True
    """Whether the blocks tell how far they scatter: not with a single one in a stratum, nor where all are equal."""

    @property
    def valid(self) -> bool:
        """Whether there is a value."""
        return self.blocks > 0

    @property
    def bounded(self) -> bool:
        """Whether the bounds mean something."""
        return self.blocks >= BLOCKS_MIN and self.scatter_known

    def __format__(self, spec: str) -> str:
        """``2.28 [2.10, 2.43]``, without bounds ``2.28 [–]``, without a value a dash."""
        return f"{self.value:{spec}} {Bounds(self):{spec}}" if self.valid else NONE

    def scaled(self, factor: float) -> "Interval":
        """The same in another unit, such as percent; the factor is positive."""
        return Interval(factor * self.value, factor * self.low, factor * self.high, self.blocks, self.scatter_known)

    def json(self) -> dict[str, Any]:
        """JSON types as all files of scores have them; null where there is no value or no bound."""
        return {
            "value": self.value if self.valid else None,
            "low": self.low if self.bounded else None,
            "high": self.high if self.bounded else None,
            "episodes": self.blocks,
        }


@dataclass(frozen=True)
class Bounds:
    """The bounds of an interval without its value."""

    interval: Interval

    def __format__(self, spec: str) -> str:
        """``[2.10, 2.43]``; ``[–]`` for a value without bounds, a dash without a value."""
        if not self.interval.bounded:
            return f"[{NONE}]" if self.interval.valid else NONE
        return f"[{self.interval.low:{spec}}, {self.interval.high:{spec}}]"


NOTHING: Final = Interval(0.0, 0.0, 0.0, 0)
"""What there is to say without any block."""


def interval_of_json(content: Mapping[str, Any] | None) -> Interval:
    """What ``Interval.json`` wrote; ``NOTHING`` for null. Files without the number of episodes are read, too."""
    if content is None or content.get("value") is None:
        return NOTHING
    value, low, high = content["value"], content.get("low"), content.get("high")
    if low is None or high is None:
        return Interval(value, value, value, int(content.get("episodes", 1)), scatter_known=False)
    return Interval(value, low, high, int(content.get("episodes", BLOCKS_MIN)))


def share_interval(part: int, whole: int, confidence: float = CONFIDENCE) -> Interval:
    """A share of independent blocks with Wilson's interval, which has a width at 0 and 1, too.

    Source: E. Wilson, J. Am. Stat. Assoc. 22 (1927) 209.
    """
    if not whole:
        return NOTHING
    square = float(ndtri(0.5 * (1.0 + confidence))) ** 2
    middle = (part + 0.5 * square) / (whole + square)
    half = math.sqrt(square * (part * (whole - part) / whole + 0.25 * square)) / (whole + square)
    return Interval(part / whole, max(middle - half, 0.0), min(middle + half, 1.0), whole)


def mean_of_intervals(parts: Sequence[Interval], blocks: int) -> Interval:
    """The mean of independent estimates with so many blocks behind all of them; those that are not valid do not count.

    Source: G. Zou, A. Donner, Statist. Med. 27 (2008) 1693: the distances to the bounds add up as squares.
    """
    known = [part for part in parts if part.valid]
    if not known:
        return NOTHING
    value = math.fsum(part.value for part in known) / len(known)
    below = math.hypot(*(part.value - part.low for part in known)) / len(known)
    above = math.hypot(*(part.high - part.value for part in known)) / len(known)
    return Interval(value, value - below, value + above, blocks)
