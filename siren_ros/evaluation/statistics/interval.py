"""A value with its confidence interval."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Final

from scipy.special import ndtri

CONFIDENCE: Final = 0.95
BLOCKS_MIN: Final = 5
"""Fewest blocks of an interval. With fewer it is wider than the value, and holds too seldom where values are skewed."""
WHY_NONE: Final = (
    f"[{{}}] is no interval: it takes {BLOCKS_MIN} episodes, 2 of each template, and values that are not all the same"
)
"""For a reader of tables; with the dash that stands in them."""


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


NOTHING: Final = Interval(0.0, 0.0, 0.0, 0)
"""What there is to say without any block."""


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
    """The mean of estimates that are independent of each other; those that are not valid do not count.

    Source: G. Zou, A. Donner, Statist. Med. 27 (2008) 1693: the distances to the bounds add up as squares.

    Args:
        parts: The estimates.
        blocks: Number of blocks behind all of them.
    """
    known = [one for one in parts if one.valid]
    if not known:
        return NOTHING
    value = math.fsum(one.value for one in known) / len(known)
    below = math.hypot(*(one.value - one.low for one in known)) / len(known)
    above = math.hypot(*(one.high - one.value for one in known)) / len(known)
    return Interval(value, value - below, value + above, blocks)


def lack_of_bounds(shown: Iterable[Interval]) -> list[str]:
    """The line below a table that has values without bounds, which stand as a dash; no line where all have them."""
    return [] if all(one.bounded for one in shown if one.valid) else [WHY_NONE.format("-")]
