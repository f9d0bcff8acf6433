"""Intervals over episodes: the jackknife leaves out one at a time, because the samples within one depend on each other.

A percentile bootstrap over few episodes is too narrow: of intervals of 95 %, 48 % hold the mean with two episodes, 84 %
with five, 92 % with twenty. ``test_coverage.py`` counts how many of these hold it.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.stats import t as student

from siren_ros.errors import InputError
from siren_ros.evaluation.statistics.block_sums import BlockSums
from siren_ros.evaluation.statistics.interval import CONFIDENCE, NOTHING, Interval
from siren_ros.numerics.arrays import Floats, Rows

_SAME: Final = 1e-12
"""Relative scatter below which all blocks say the same: sums of other order differ by rounding."""


@dataclass(frozen=True)
class Estimate:
    """An estimate from some blocks, with its standard error and the degrees of freedom of that error."""

    value: float
    error: float
    degrees: float
    blocks: int
    scatter_known: bool
    """Whether every stratum has several blocks, and not all blocks say the same."""

    def interval(self, confidence: float = CONFIDENCE) -> Interval:
        """By Student's t; it is symmetric. Raises InputError where the confidence is not between 0 and 1."""
        if not 0.0 < confidence < 1.0:
            raise InputError("confidence", confidence, "between 0 and 1")
        if not self.scatter_known:
            return Interval(self.value, self.value, self.value, self.blocks, scatter_known=False)
        half = float(student.ppf(0.5 * (1.0 + confidence), self.degrees)) * self.error
        return Interval(self.value, self.value - half, self.value + half, self.blocks)

    def draws(self, count: int, rng: np.random.Generator) -> Floats:
        """Values that may be the true one, as probable as Student's t has them, shape ``(count,)``."""
        return self.value + self.error * rng.standard_t(max(self.degrees, 1.0), count)


def jackknife(value: float, left_out: Floats, stratum: Rows) -> Estimate:
    """The stratified jackknife (J. Shao, D. Tu, The Jackknife and Bootstrap, 1995, sect. 6.2).

    The degrees of freedom are Welch's and Satterthwaite's (Biometrics Bull. 2 (1946) 110); one less than the blocks
    where there is one stratum.

    Args:
        value: The estimate from all blocks.
        left_out: The estimate without each of them, shape ``(B,)``; ignored where a block is alone in its stratum. NaN
            where there is no estimate without it: how far the blocks scatter is not known then.
        stratum: Of each block, shape ``(B,)``.
    """
    variance, squares, known = 0.0, 0.0, len(stratum) > 0
    for one in np.unique(stratum).tolist():
        here = left_out[stratum == one]
        count = len(here)
        if count == 1 or not np.isfinite(here).all():
            known = False
            continue
        own = (count - 1) / count * float(np.sum((here - here.mean()) ** 2))
        variance += own
        squares += own**2 / (count - 1)
    error = float(np.sqrt(variance))
    known &= error > _SAME * max(abs(value), 1.0)
    degrees = variance**2 / squares if squares else 0.0
    return Estimate(value, error, degrees, len(stratum), known)


def estimate_of_mean(sums: BlockSums) -> Estimate:
    """The mean (``BlockSums.mean``); blocks without values do not count, and there is at least one with values."""
    there = sums.with_values()
    return jackknife(there.value(), there.left_out(), there.stratum)


def interval_of_mean(sums: BlockSums, confidence: float = CONFIDENCE) -> Interval:
    """The mean (``BlockSums.mean``) with its interval; blocks without values do not count."""
    return estimate_of_mean(sums).interval(confidence) if (sums.count > 0).any() else NOTHING
