"""Spearman's rank correlation, exact for few pairs."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import permutations
from typing import Final

import numpy as np
from scipy.stats import rankdata
from scipy.stats import t as student

from siren_ros.errors import InputError
from siren_ros.evaluation.statistics.block_means import Estimate
from siren_ros.numerics.arrays import Floats
from siren_ros.tables.interval import CONFIDENCE, Interval

RANKED_MIN: Final = 3
"""Fewest pairs of a rank correlation."""
_ENUMERATED_PAIRS: Final = 8
"""With at most so many pairs the test tries all orders (40,320)."""


@dataclass(frozen=True)
class RankCorrelation:
    """Spearman's ρ with the probability that chance alone gives one at least as far from 0."""

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
    if len(first) < RANKED_MIN:
        return None
    ranks, against = (rankdata(values) - (len(values) + 1) / 2.0 for values in (first, second))
    spread = float(np.sqrt((ranks @ ranks) * (against @ against)))
    if spread == 0.0:
        return None
    rho = float(ranks @ against) / spread
    return RankCorrelation(rho, _p_value(ranks, against, rho), len(first))


def ranking_interval(estimates: Sequence[Estimate], other: Sequence[float], confidence: float = CONFIDENCE) -> Interval:
    """Spearman's ρ between estimates and known values, with its interval; ρ of equal values is 0 here.

    Ranks jump, and noise pulls ρ towards 0: neither the jackknife nor a bootstrap of ρ holds the true one. The bounds
    are those over all orders that the estimates' own intervals allow, which hold all true values at once with the
    probability asked for (M. Klein et al., J. R. Stat. Soc. C 69 (2020) 589). So they are rather too wide. With more
    than eight estimates there are none.

    Args:
        estimates: At least one, independent of each other.
        other: The known values, as many.
        confidence: Of the interval, between 0 and 1.
    """
    blocks, count = sum(estimate.blocks for estimate in estimates), len(estimates)
    value = float(_rhos(np.array([[estimate.value for estimate in estimates]]), other)[0])
    if count > _ENUMERATED_PAIRS or not all(estimate.scatter_known for estimate in estimates):
        return Interval(value, value, value, blocks, scatter_known=False)
    intervals = [estimate.interval(confidence ** (1.0 / count)) for estimate in estimates]
    orders = np.array(list(permutations(range(count))))
    low, high = (np.array([getattr(interval, side) for interval in intervals])[orders] for side in ("low", "high"))
    possible = orders[(np.maximum.accumulate(low, axis=1) <= high).all(axis=1)]
    correlations = _rhos(np.argsort(possible, axis=1).astype(np.float64), other)
    return Interval(value, min(value, *correlations.tolist()), max(value, *correlations.tolist()), blocks)


def _rhos(values: Floats, other: Sequence[float]) -> Floats:
    """ρ between each row and the other side, shape ``(R,)``; 0 where all values of a side are equal."""
    centre = (len(other) + 1) / 2.0
    ranks, against = rankdata(values, axis=1) - centre, rankdata(other) - centre
    spread = np.sqrt((ranks**2).sum(axis=1) * (against @ against))
    return np.asarray(ranks @ against / np.where(spread > 0.0, spread, 1.0), dtype=np.float64)


def _p_value(ranks: Floats, against: Floats, rho: float) -> float:
    count = len(ranks)
    if count <= _ENUMERATED_PAIRS:
        products = against[np.array(list(permutations(range(count))))] @ ranks
        return float(np.mean(np.abs(products) >= abs(float(ranks @ against)) - 1e-9))
    if abs(rho) >= 1.0:
        return 0.0
    return float(2.0 * student.sf(abs(rho) * np.sqrt((count - 2) / (1.0 - rho**2)), count - 2))
