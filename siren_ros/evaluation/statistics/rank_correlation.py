"""Spearman's rank correlation, exact for few pairs."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import permutations
from typing import Final

import numpy as np
from scipy.stats import rankdata
from scipy.stats import t as student

from siren_ros.errors import InputError
from siren_ros.numerics.arrays import Floats

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
    one, two = _centred_ranks(first), _centred_ranks(second)
    spread = float(np.sqrt((one @ one) * (two @ two)))
    if spread == 0.0:
        return None
    rho = float(one @ two) / spread
    return RankCorrelation(rho, _p_value(one, two, rho * spread), len(first))


def rank_rho(first: Sequence[float], second: Sequence[float]) -> float:
    """Spearman's ρ alone, for resampling; 0 where all values of one side are equal, of which it says nothing."""
    one, two = _centred_ranks(first), _centred_ranks(second)
    spread = float(np.sqrt((one @ one) * (two @ two)))
    return float(one @ two) / spread if spread else 0.0


def _centred_ranks(values: Sequence[float]) -> Floats:
    return np.asarray(rankdata(values) - (len(values) + 1) / 2.0, dtype=np.float64)


def _p_value(one: Floats, two: Floats, product: float) -> float:
    count = len(one)
    if count <= _ENUMERATED_PAIRS:
        products = two[np.array(list(permutations(range(count))))] @ one
        return float(np.mean(np.abs(products) >= abs(product) - 1e-9))
    rho = product / float(np.sqrt((one @ one) * (two @ two)))
    if abs(rho) >= 1.0:
        return 0.0
    return float(2.0 * student.sf(abs(rho) * np.sqrt((count - 2) / (1.0 - rho**2)), count - 2))
