"""Block bootstrap: episodes are drawn again with replacement, because the samples within one depend on each other."""

from collections.abc import Callable

import numpy as np

from siren_ros.errors import InputError
from siren_ros.evaluation.statistics.block_sums import BlockSums
from siren_ros.evaluation.statistics.interval import CONFIDENCE, NOTHING, RESAMPLES, Interval, percentile_interval
from siren_ros.numerics.arrays import Floats, Rows


def draw_blocks(stratum: Rows, resamples: int, rng: np.random.Generator) -> Rows:
    """Blocks of each resample, drawn within their strata, shape ``(resamples, B)``.

    Args:
        stratum: Of each block, shape ``(B,)``; a resample has as many blocks of each stratum as there are.
        resamples: Their number.
        rng: Random generator.
    """
    if resamples < 1:
        raise InputError("resamples", resamples, "1 or more")
    drawn = np.zeros((resamples, len(stratum)), dtype=np.intp)
    for one in np.unique(stratum).tolist():
        members = np.flatnonzero(stratum == one)
        drawn[:, members] = members[rng.integers(len(members), size=(resamples, len(members)))]
    return drawn


def times_drawn(stratum: Rows, resamples: int, rng: np.random.Generator) -> Floats:
    """How often each resample holds each block, shape ``(resamples, B)``; as ``draw_blocks``."""
    drawn = draw_blocks(stratum, resamples, rng)
    count = len(stratum)
    flat = (drawn + count * np.arange(resamples)[:, None]).ravel()
    return np.bincount(flat, minlength=resamples * count).reshape(resamples, count).astype(np.float64)


def interval_of_mean(
    sums: BlockSums,
    rng: np.random.Generator,
    resamples: int = RESAMPLES,
    confidence: float = CONFIDENCE,
) -> Interval:
    """The mean (``BlockSums.mean``) with its interval; blocks without values do not count."""
    there = sums.with_values()
    if len(there) == 0:
        return NOTHING
    (value,) = there.mean(np.ones((1, len(there))))
    resampled = there.mean(times_drawn(there.stratum, resamples, rng)) if len(there) > 1 else np.array([value])
    return percentile_interval(float(value), resampled, there.stratum, confidence)


def interval_of(
    statistic: Callable[[Rows], float],
    stratum: Rows,
    rng: np.random.Generator,
    resamples: int = RESAMPLES,
    confidence: float = CONFIDENCE,
) -> Interval:
    """Any statistic with its interval: it is computed anew for each resample.

    Args:
        statistic: Takes the numbers of the blocks drawn, some several times, shape ``(B,)``. It must be finite.
        stratum: Of each block, shape ``(B,)``; zeros where all are drawn together.
        rng: Random generator.
        resamples: Their number.
        confidence: Share of the resamples within the interval.
    """
    count = len(stratum)
    if count == 0:
        return NOTHING
    value = statistic(np.arange(count))
    drawn = draw_blocks(stratum, resamples, rng) if count > 1 else np.zeros((0, 1), dtype=np.intp)
    return percentile_interval(value, np.array([statistic(blocks) for blocks in drawn]), stratum, confidence)
