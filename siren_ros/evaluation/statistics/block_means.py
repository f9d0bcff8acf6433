"""Means over samples whose blocks (episodes) are independent: their intervals, and differences between two models.

The jackknife leaves out one episode at a time, because the samples within one depend on each other. A percentile
bootstrap over few episodes is too narrow: of intervals of 95 %, 48 % hold the mean with two episodes, 84 % with five,
92 % with twenty. ``test_coverage.py`` counts how many of these hold it.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.stats import t as student

from siren_ros.errors import InputError
from siren_ros.numerics.arrays import Flags, Floats, Rows
from siren_ros.tables.interval import CONFIDENCE, NOTHING, Interval


def identity(values: Floats) -> Floats:
    """The values themselves."""
    return values


@dataclass(frozen=True)
class BlockSums:
    """Sums of some quantity over B blocks; a block is an episode, a stratum its template. Arrays of shape ``(B,)``."""

    total: Floats
    count: Floats
    """Number of values in each block."""
    stratum: Rows
    of_stratum: Callable[[Floats], Floats] = identity
    """What is done to a stratum's mean before the mean over the strata: the root, of squares."""

    def __len__(self) -> int:
        return len(self.total)

    def with_values(self) -> "BlockSums":
        """Those blocks that have a value."""
        return self._at(self.count > 0)

    def value(self) -> float:
        """Mean over the strata, each counted once, of the means over all values of a stratum."""
        return float(self.mean_of(self.total[None], self.count[None])[0])

    def left_out(self) -> Floats:
        """The same without each block, shape ``(B,)``; with all where a block is alone in its stratum."""
        strata, stratum, blocks = np.unique(self.stratum, return_inverse=True, return_counts=True)
        totals, counts = (np.bincount(stratum, weights=sums)[stratum] for sums in (self.total, self.count))
        shared = blocks[stratum] > 1
        others = self.of_stratum((totals - self.total * shared) / (counts - self.count * shared))
        return self.value() + (others - self.of_stratum(totals / counts)) / len(strata)

    def of(self, stratum: int) -> "BlockSums":
        """The blocks of one stratum."""
        return self._at(self.stratum == stratum)

    def _at(self, chosen: Flags) -> "BlockSums":
        return BlockSums(self.total[chosen], self.count[chosen], self.stratum[chosen], self.of_stratum)

    def mean_of(self, totals: Floats, counts: Floats) -> Floats:
        """As ``value``, of other sums over the same blocks; shapes ``(R, B)`` give ``(R,)``."""
        of_strata = [
            self.of_stratum(totals[:, here].sum(axis=1) / counts[:, here].sum(axis=1))
            for here in (self.stratum == number for number in np.unique(self.stratum).tolist())
        ]
        return np.asarray(np.mean(of_strata, axis=0), dtype=np.float64)


def block_sums(
    values: Floats, block: Rows, stratum: Rows, of_stratum: Callable[[Floats], Floats] = identity
) -> BlockSums:
    """Sums of values over their blocks; NaN is no value.

    Args:
        values: Shape ``(N,)``.
        block: Block of each value, shape ``(N,)``.
        stratum: Stratum of each block, shape ``(B,)``.
        of_stratum: As in ``BlockSums``.
    """
    there = ~np.isnan(values)
    blocks = len(stratum)
    return BlockSums(
        np.bincount(block[there], weights=values[there], minlength=blocks).astype(np.float64),
        np.bincount(block[there], minlength=blocks).astype(np.float64),
        stratum,
        of_stratum,
    )


def holm(p_values: Sequence[float]) -> list[float]:
    """p-values that hold for all tests together (S. Holm, Scand. J. Statist. 6 (1979) 65), in the given order."""
    count = len(p_values)
    order = np.argsort(p_values, kind="stable")
    stepped = np.minimum(np.asarray(p_values, dtype=np.float64)[order] * np.arange(count, 0, -1), 1.0)
    adjusted = np.empty(count)
    adjusted[order] = np.maximum.accumulate(stepped) if count else stepped
    return [float(value) for value in adjusted]


_SAME: Final = 1e-12
"""Relative scatter below which all blocks say the same, and tolerance at which two differences count as equal: sums of
other order differ by rounding."""


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
    for number in np.unique(stratum).tolist():
        here = left_out[stratum == number]
        count = len(here)
        if count == 1 or not np.isfinite(here).all():
            known = False
            continue
        of_stratum = (count - 1) / count * float(np.sum((here - here.mean()) ** 2))
        variance += of_stratum
        squares += of_stratum**2 / (count - 1)
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


ENUMERATED_BLOCKS: Final = 12
"""With at most so many blocks the test tries all 4096 exchanges."""
_RANDOM_EXCHANGES: Final = 4096


@dataclass(frozen=True)
class PairedDifference:
    """The first model's mean minus the second's; negative where the first has the smaller errors."""

    difference: Interval
    p_value: float
    """Of the test of exchanged blocks: small where the difference is hardly chance. 1 with one block or none."""


def paired_difference(
    first: BlockSums, second: BlockSums, rng: np.random.Generator, confidence: float = CONFIDENCE
) -> PairedDifference:
    """Compares two models that were scored on the same samples.

    The interval is the jackknife's, which leaves out a block of both at once. The p-value is that of a permutation
    test: if the two were alike, they could be exchanged within any block. It is the share of exchanges whose difference
    is at least as far from 0 as the one found; all exchanges for few blocks, otherwise random ones (B. Phipson,
    G. Smyth, Stat. Appl. Genet. Mol. Biol. 9 (2010) 39). With B blocks it is not below 2 / 2ᴮ.

    Raises:
        InputError: The two do not have the same numbers of values in the same blocks.
    """
    if len(first) != len(second) or not np.array_equal(first.count, second.count):
        raise InputError("paired models", f"{len(first)} and {len(second)} blocks", "the same samples in every block")
    first, second = first.with_values(), second.with_values()
    if len(first) == 0:
        return PairedDifference(NOTHING, 1.0)
    difference = first.value() - second.value()
    interval = jackknife(difference, first.left_out() - second.left_out(), first.stratum).interval(confidence)
    return PairedDifference(interval, _p_value(first, second, difference, rng))


def _p_value(first: BlockSums, second: BlockSums, difference: float, rng: np.random.Generator) -> float:
    blocks = len(first)
    exact = blocks <= ENUMERATED_BLOCKS
    exchanged: Flags = (
        (np.arange(2**blocks)[:, None] >> np.arange(blocks) & 1).astype(np.bool_)
        if exact
        else rng.random((_RANDOM_EXCHANGES, blocks)) < 0.5
    )
    counts = np.ones((1, blocks)) * first.count
    here = first.mean_of(np.where(exchanged, second.total, first.total), counts)
    there = second.mean_of(np.where(exchanged, first.total, second.total), counts)
    limit = abs(difference) - _SAME * max(abs(difference), 1.0)
    as_far = int(np.count_nonzero(np.abs(here - there) >= limit))
    return as_far / len(exchanged) if exact else (as_far + 1) / (len(exchanged) + 1)
