"""Means over samples whose blocks (episodes) are independent, differences between two models, and rank correlation.

The jackknife leaves out one episode at a time, because the samples within one depend on each other. A percentile
bootstrap over few episodes is too narrow: of intervals of 95 %, 48 % hold the mean with two episodes, 84 % with five,
92 % with twenty. ``test_statistics.py`` counts how many of these hold it. Episodes are not known here.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import permutations
from typing import Final

import numpy as np
import numpy.typing as npt
from scipy.special import stdtr, stdtrit

from siren_ros.base.numerics.arrays import Flags, Floats, Rows
from siren_ros.base.tables import CONFIDENCE, NOTHING, Interval
from siren_ros.errors import InputError


def identity(values: Floats) -> Floats:
    """The values themselves."""
    return values


@dataclass(frozen=True)
class BlockSums:
    """Sums of a quantity over B blocks; a block is an episode, a stratum its template. Arrays of shape ``(B,)``."""

    total: Floats
    count: Floats
    """Number of values in each block."""
    stratum: Rows
    of_stratum: Callable[[Floats], Floats] = identity
    """Applied to a stratum's mean before the mean over strata: for example the root of a mean of squares."""

    def __len__(self) -> int:
        return len(self.total)

    def select(self, blocks: Flags) -> "BlockSums":
        """Select some of the blocks."""
        return BlockSums(self.total[blocks], self.count[blocks], self.stratum[blocks], self.of_stratum)

    def value(self) -> float:
        """Mean over the strata, which count equally, of the means over all values of a stratum."""
        return float(self.mean_of(self.total[None], self.count[None])[0])

    def left_out(self) -> Floats:
        """The value without each block, shape ``(B,)``; the full value where a block is alone in its stratum."""
        strata, stratum, blocks = np.unique(self.stratum, return_inverse=True, return_counts=True)
        totals, counts = (np.bincount(stratum, weights=sums)[stratum] for sums in (self.total, self.count))
        shared = blocks[stratum] > 1
        others = self.of_stratum((totals - self.total * shared) / (counts - self.count * shared))
        return self.value() + (others - self.of_stratum(totals / counts)) / len(strata)

    def mean_of(self, totals: Floats, counts: Floats) -> Floats:
        """As ``value``, for other sums over the same blocks; shapes ``(R, B)`` give ``(R,)``."""
        of_strata = [
            self.of_stratum(totals[:, members].sum(axis=1) / counts[:, members].sum(axis=1))
            for members in (self.stratum == number for number in np.unique(self.stratum).tolist())
        ]
        return np.asarray(np.mean(of_strata, axis=0), dtype=np.float64)


def block_sums(
    values: Floats, block: Rows, stratum: Rows, of_stratum: Callable[[Floats], Floats] = identity
) -> BlockSums:
    """Sum values over their blocks.

    Args:
        values: Shape ``(N,)``; NaN is no value.
        block: Block of each value, shape ``(N,)``.
        stratum: Stratum of each block, shape ``(B,)``.
        of_stratum: As in ``BlockSums``.
    """
    known = ~np.isnan(values)
    total, count = (
        np.bincount(block[known], weights=weights, minlength=len(stratum)).astype(np.float64)
        for weights in (values[known], None)
    )
    return BlockSums(total, count, stratum, of_stratum)


def holm(p_values: Sequence[float]) -> list[float]:
    """Adjust p-values for several tests (S. Holm, Scand. J. Statist. 6 (1979) 65); the order stays."""
    count = len(p_values)
    order = np.argsort(p_values, kind="stable")
    stepped = np.minimum(np.asarray(p_values, dtype=np.float64)[order] * np.arange(count, 0, -1), 1.0)
    adjusted = np.empty(count)
    adjusted[order] = np.maximum.accumulate(stepped)
    return [float(value) for value in adjusted]


_SAME: Final = 1e-12
"""Relative tolerance below which blocks or differences count as equal, because the order of a sum changes its
rounding."""


@dataclass(frozen=True)
class Estimate:
    """An estimate from some blocks, with its standard error and the degrees of freedom of that error."""

    value: float
    error: float
    degrees: float
    blocks: int
    scatter_known: bool
    """Whether the scatter is known: every stratum has several blocks, and not all blocks are equal."""

    def interval(self, confidence: float = CONFIDENCE) -> Interval:
        """Interval by Student's t; it is symmetric. Raises InputError unless the confidence is between 0 and 1."""
        if not 0.0 < confidence < 1.0:
            raise InputError("confidence", confidence, "between 0 and 1")
        if not self.scatter_known:
            return Interval(self.value, self.value, self.value, self.blocks, scatter_known=False)
        half = float(stdtrit(self.degrees, 0.5 * (1.0 + confidence))) * self.error
        return Interval(self.value, self.value - half, self.value + half, self.blocks)

    def draws(self, count: int, rng: np.random.Generator) -> Floats:
        """Random values for the true value, distributed by Student's t around the estimate, shape ``(count,)``."""
        return self.value + self.error * rng.standard_t(max(self.degrees, 1.0), count)


def jackknife(value: float, left_out: Floats, stratum: Rows) -> Estimate:
    """Standard error by the stratified jackknife (J. Shao, D. Tu, The Jackknife and Bootstrap, 1995, sect. 6.2).

    The degrees of freedom are Welch's and Satterthwaite's (Biometrics Bull. 2 (1946) 110); one less than the blocks
    where there is one stratum.

    Args:
        value: The estimate from all blocks.
        left_out: The estimate without each of them, shape ``(B,)``; ignored where a block is alone in its stratum. NaN
            where there is no estimate without it: how far the blocks scatter is not known then.
        stratum: Stratum of each block, shape ``(B,)``.
    """
    variance, squares, known = 0.0, 0.0, len(stratum) > 0
    for number in np.unique(stratum).tolist():
        estimates = left_out[stratum == number]
        count = len(estimates)
        if count == 1 or not np.isfinite(estimates).all():
            known = False
            continue
        of_stratum = (count - 1) / count * float(np.sum((estimates - estimates.mean()) ** 2))
        variance += of_stratum
        squares += of_stratum**2 / (count - 1)
    error = float(np.sqrt(variance))
    known &= error > _SAME * max(abs(value), 1.0)
    return Estimate(value, error, variance**2 / squares if squares else 0.0, len(stratum), known)


def estimate_of_mean(sums: BlockSums) -> Estimate:
    """Estimate of the mean (``BlockSums.value``). Blocks without values do not count; at least one has values."""
    filled = sums.select(sums.count > 0)
    return jackknife(filled.value(), filled.left_out(), filled.stratum)


def interval_of_mean(sums: BlockSums, confidence: float = CONFIDENCE) -> Interval:
    """The mean (``BlockSums.value``) with its interval; blocks without values do not count."""
    return estimate_of_mean(sums).interval(confidence) if (sums.count > 0).any() else NOTHING


ENUMERATED_BLOCKS: Final = 12
"""Up to this many blocks the test tries all 4096 exchanges."""
_RANDOM_EXCHANGES: Final = 4096


def paired_difference(
    first: BlockSums, second: BlockSums, rng: np.random.Generator, confidence: float = CONFIDENCE
) -> tuple[Interval, float]:
    """The first model's mean minus the second's on the same samples, and the p-value: small if it is hardly chance.

    The interval is the jackknife's, which leaves out a block of both at once. The p-value is that of a permutation
    test: if the two were alike, they could be exchanged within any block. It is the share of exchanges whose difference
    is at least as far from 0 as the measured one; all exchanges for few blocks, otherwise random ones (B. Phipson,
    G. Smyth, Stat. Appl. Genet. Mol. Biol. 9 (2010) 39). With B blocks it is not below 2 / 2ᴮ; 1 without blocks.

    Raises:
        InputError: The two do not have the same numbers of values in the same blocks.
    """
    if len(first) != len(second) or not np.array_equal(first.count, second.count):
        raise InputError("paired models", f"{len(first)} and {len(second)} blocks", "the same samples in every block")
    first, second = (sums.select(sums.count > 0) for sums in (first, second))
    if len(first) == 0:
        return NOTHING, 1.0
    difference = first.value() - second.value()
    interval = jackknife(difference, first.left_out() - second.left_out(), first.stratum).interval(confidence)
    return interval, _p_of_exchanges(first, second, difference, rng)


def _p_of_exchanges(first: BlockSums, second: BlockSums, difference: float, rng: np.random.Generator) -> float:
    blocks = len(first)
    exact = blocks <= ENUMERATED_BLOCKS
    exchanged: Flags = (
        (np.arange(2**blocks)[:, None] >> np.arange(blocks) & 1).astype(np.bool_)
        if exact
        else rng.random((_RANDOM_EXCHANGES, blocks)) < 0.5
    )
    counts = np.ones((1, blocks)) * first.count
    of_first = first.mean_of(np.where(exchanged, second.total, first.total), counts)
    of_second = second.mean_of(np.where(exchanged, first.total, second.total), counts)
    limit = abs(difference) - _SAME * max(abs(difference), 1.0)
    as_far = int(np.count_nonzero(np.abs(of_first - of_second) >= limit))
    return as_far / len(exchanged) if exact else (as_far + 1) / (len(exchanged) + 1)


RANKED_MIN: Final = 3
"""Fewest pairs of a rank correlation."""
_ENUMERATED_PAIRS: Final = 8
"""Up to this many pairs the test tries all orders (40,320)."""


@dataclass(frozen=True)
class RankCorrelation:
    """Spearman's ρ, with the probability that chance gives a value at least as far from 0."""

    rho: float
    p_value: float
    pairs: int


def rank_correlation(first: Sequence[float], second: Sequence[float]) -> RankCorrelation | None:
    """Spearman's rank correlation; None with fewer than three pairs or where all values of one side are equal.

    Equal values share their mean rank. The p-value is two-sided: exact up to eight pairs, above by Student's t
    (J. Zar, J. Am. Stat. Assoc. 67 (1972) 578).

    Raises:
        InputError: The sides have different lengths.
    """
    if len(first) != len(second):
        raise InputError("rank correlation", f"{len(first)} and {len(second)} values", "two sides of the same length")
    count = len(first)
    if count < RANKED_MIN:
        return None
    ranks, against = (_ranks(values) - (count + 1) / 2.0 for values in (first, second))
    spread = float(np.sqrt((ranks @ ranks) * (against @ against)))
    if spread == 0.0:
        return None
    product = float(ranks @ against)
    rho = product / spread
    if count <= _ENUMERATED_PAIRS:
        products = against[np.array(list(permutations(range(count))))] @ ranks
        p_value = float(np.mean(np.abs(products) >= abs(product) - 1e-9))
    elif abs(rho) >= 1.0:
        p_value = 0.0
    else:
        p_value = float(2.0 * stdtr(count - 2, -abs(rho) * np.sqrt((count - 2) / (1.0 - rho**2))))
    return RankCorrelation(rho, p_value, count)


def ranking_interval(estimates: Sequence[Estimate], other: Sequence[float], confidence: float = CONFIDENCE) -> Interval:
    """Spearman's ρ between estimates and known values with its interval; ρ of equal values is 0 here.

    Ranks jump, and noise pulls ρ towards 0: neither the jackknife nor a bootstrap of ρ holds the true one. The bounds
    are those over all orders that the estimates' own intervals allow, which hold all true values at once with the
    probability asked for (M. Klein et al., J. R. Stat. Soc. C 69 (2020) 589). So they are rather too wide. With more
    than eight estimates there are none.

    Args:
        estimates: At least one, independent of each other.
        other: The known values, as many.
        confidence: Confidence of the interval, between 0 and 1.
    """
    blocks, count = sum(estimate.blocks for estimate in estimates), len(estimates)
    value = float(_rhos(np.array([[estimate.value for estimate in estimates]]), other)[0])
    if count > _ENUMERATED_PAIRS or not all(estimate.scatter_known for estimate in estimates):
        return Interval(value, value, value, blocks, scatter_known=False)
    intervals = [estimate.interval(confidence ** (1.0 / count)) for estimate in estimates]
    orders = np.array(list(permutations(range(count))))
    low, high = (np.array([getattr(interval, side) for interval in intervals])[orders] for side in ("low", "high"))
    possible = orders[(np.maximum.accumulate(low, axis=1) <= high).all(axis=1)]
    correlations = [value, *_rhos(np.argsort(possible, axis=1).astype(np.float64), other).tolist()]
    return Interval(value, min(correlations), max(correlations), blocks)


def _ranks(values: npt.ArrayLike) -> Floats:
    """Ranks along the last axis, from 1; equal values share their mean rank."""
    from scipy.stats import rankdata  # noqa: PLC0415 - takes half a second to load, and few tables need it

    return np.asarray(rankdata(values, axis=-1), np.float64)


def _rhos(values: Floats, other: Sequence[float]) -> Floats:
    """ρ between each row and the other side, shape ``(R,)``; 0 where all values of a side are equal."""
    centre = (len(other) + 1) / 2.0
    ranks, against = _ranks(values) - centre, _ranks(other) - centre
    spread = np.sqrt((ranks**2).sum(axis=1) * (against @ against))
    return np.asarray(ranks @ against / np.where(spread > 0.0, spread, 1.0), dtype=np.float64)
