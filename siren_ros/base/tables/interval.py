"""A value that may be missing; an estimate with its confidence interval, and intervals of shares and of means."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, Self

from scipy.special import ndtri

NONE: Final = "–"
"""Text for a missing value."""
CONFIDENCE: Final = 0.95
BLOCKS_MIN: Final = 5
"""Smallest number of blocks for an interval. With fewer it is too wide, and too often wrong for skewed values."""


@dataclass(frozen=True)
class Measure:
    """A measured value of an episode. If nothing could be measured, ``value`` is 0 and ``lack`` gives the reason."""

    value: float
    lack: str = ""
    at_least: bool = False
    """Whether the value is only a lower bound, because the episode ended first."""

    @property
    def valid(self) -> bool:
        """Whether there is a value."""
        return not self.lack

    @property
    def text(self) -> str:
        """Text for a table: the value, with ``at least`` before a lower bound, or the reason why there is none."""
        return f"{'at least ' * self.at_least}{self.value:.2f}" if self.valid else f"{NONE} ({self.lack})"

    @classmethod
    def lacking(cls, reason: str) -> Self:
        """A measure without a value."""
        return cls(0.0, reason)


@dataclass(frozen=True)
class Interval:
    """An estimate from some blocks. If it is not ``bounded``, ``low`` and ``high`` are meaningless."""

    value: float
    low: float
    high: float
    blocks: int
    """Number of independent blocks (episodes) of the estimate."""
    scatter_known: bool = True
    """Whether the blocks show their scatter: not if a stratum has only one, or if all are equal."""

    @property
    def valid(self) -> bool:
        """Whether there is a value."""
        return self.blocks > 0

    @property
    def bounded(self) -> bool:
        """Whether the bounds are meaningful."""
        return self.blocks >= BLOCKS_MIN and self.scatter_known

    def __format__(self, spec: str) -> str:
        """``2.28 [2.10, 2.43]``; ``2.28 [–]`` without bounds; a dash without a value."""
        return f"{self.value:{spec}} {Bounds(self):{spec}}" if self.valid else NONE

    def scaled(self, factor: float) -> "Interval":
        """The interval in another unit, such as percent; the factor is positive."""
        return Interval(factor * self.value, factor * self.low, factor * self.high, self.blocks, self.scatter_known)

    def json(self) -> dict[str, Any]:
        """JSON types as in all files of scores; null for a missing value or bound."""
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
        """``[2.10, 2.43]``; ``[–]`` for a value without bounds; a dash without a value."""
        if not self.interval.bounded:
            return f"[{NONE}]" if self.interval.valid else NONE
        return f"[{self.interval.low:{spec}}, {self.interval.high:{spec}}]"


NOTHING: Final = Interval(0.0, 0.0, 0.0, 0)
"""The interval without any block."""


def interval_of_json(content: Mapping[str, Any] | None) -> Interval:
    """Inverse of ``Interval.json``; ``NOTHING`` for null. It also reads files without the number of episodes."""
    if content is None or content.get("value") is None:
        return NOTHING
    value, low, high = content["value"], content.get("low"), content.get("high")
    if low is None or high is None:
        return Interval(value, value, value, int(content.get("episodes", 1)), scatter_known=False)
    return Interval(value, low, high, int(content.get("episodes", BLOCKS_MIN)))


def share_interval(part: int, whole: int, confidence: float = CONFIDENCE) -> Interval:
    """Wilson's interval of a share of independent blocks; it has a width even at 0 and 1.

    Source: E. Wilson, J. Am. Stat. Assoc. 22 (1927) 209.
    """
    if not whole:
        return NOTHING
    square = float(ndtri(0.5 * (1.0 + confidence))) ** 2
    middle = (part + 0.5 * square) / (whole + square)
    half = math.sqrt(square * (part * (whole - part) / whole + 0.25 * square)) / (whole + square)
    return Interval(part / whole, max(middle - half, 0.0), min(middle + half, 1.0), whole)


def mean_of_intervals(parts: Sequence[Interval], blocks: int) -> Interval:
    """Mean of independent estimates, given their total number of blocks; estimates that are not valid do not count.

    Source: G. Zou, A. Donner, Statist. Med. 27 (2008) 1693: the distances to the bounds add up as squares.
    """
    known = [part for part in parts if part.valid]
    if not known:
        return NOTHING
    value = math.fsum(part.value for part in known) / len(known)
    below = math.hypot(*(part.value - part.low for part in known)) / len(known)
    above = math.hypot(*(part.high - part.value for part in known)) / len(known)
    return Interval(value, value - below, value + above, blocks)
