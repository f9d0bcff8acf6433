"""A value with its confidence interval."""

from dataclasses import dataclass
from typing import Final

import numpy as np

from siren_ros.errors import InputError
from siren_ros.numerics.arrays import Floats, Rows

CONFIDENCE: Final = 0.95
RESAMPLES: Final = 2000
"""Enough for the 2.5th percentile: 50 resamples lie below it."""


@dataclass(frozen=True)
class Interval:
    """An estimate from some blocks. Where it is not ``bounded``, ``low`` and ``high`` mean nothing."""

    value: float
    low: float
    high: float
    blocks: int
    """Number of independent blocks (episodes) behind it."""
    single: bool = False
    """Whether a stratum has a single block: how such blocks scatter is not known, and the bounds would hide it."""

    @property
    def valid(self) -> bool:
        """Whether there is a value."""
        return self.blocks > 0

    @property
    def bounded(self) -> bool:
        """Whether the bounds mean something: two blocks or more in each stratum."""
        return self.blocks > 1 and not self.single


NOTHING: Final = Interval(0.0, 0.0, 0.0, 0)
"""What there is to say without any block."""


def percentile_interval(value: float, resampled: Floats, stratum: Rows, confidence: float = CONFIDENCE) -> Interval:
    """The percentile interval (B. Efron, R. Tibshirani, An Introduction to the Bootstrap, 1993, sect. 13.3).

    Args:
        value: The estimate from all blocks.
        resampled: The same estimate from each resample, shape ``(R,)``.
        stratum: Of each block, shape ``(B,)``.
        confidence: Share of the resamples within the interval, between 0 and 1.
    """
    if not 0.0 < confidence < 1.0:
        raise InputError("confidence", confidence, "between 0 and 1")
    blocks = len(stratum)
    single = bool((np.unique(stratum, return_counts=True)[1] == 1).any())
    if blocks < 2:
        return Interval(value, value, value, blocks, single)
    outside = 0.5 * (1.0 - confidence)
    low, high = np.quantile(resampled, (outside, 1.0 - outside))
    return Interval(value, float(low), float(high), blocks, single)
