from collections.abc import Sequence
from itertools import permutations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import spearmanr

from siren_ros.errors import InputError
from siren_ros.evaluation.statistics.block_means import Estimate
from siren_ros.evaluation.statistics.rank_correlation import RankCorrelation, rank_correlation, ranking_interval
from siren_ros.tables.interval import Interval


def ranked(first: Sequence[float], second: Sequence[float]) -> RankCorrelation:
    """The correlation of two sides that have one."""
    found = rank_correlation(first, second)
    assert found is not None
    return found


@given(st.lists(st.tuples(st.integers(0, 4), st.integers(0, 4)), min_size=3, max_size=10))
def test_rank_correlation_is_spearmans(pairs: list[tuple[int, int]]) -> None:
    first, second = (list(map(float, side)) for side in zip(*pairs, strict=True))
    if len(set(first)) == 1 or len(set(second)) == 1:
        assert rank_correlation(first, second) is None
    else:
        assert ranked(first, second).rho == pytest.approx(spearmanr(first, second).statistic, abs=1e-12)
        assert ranked(first, second).pairs == len(pairs)


def test_a_reversed_order() -> None:
    found = ranked([1.0, 2.0, 9.0], [3.0, 2.0, 1.0])
    assert found.rho == pytest.approx(-1.0)
    assert found.p_value == pytest.approx(2.0 / 6.0), "two of the six orders are as extreme"


def test_the_p_value_counts_the_orders() -> None:
    first, second = [1.0, 2.0, 3.0, 4.0, 5.0], [1.0, 3.0, 2.0, 5.0, 4.0]
    rhos = [abs(spearmanr(first, order).statistic) for order in permutations(second)]
    found = ranked(first, second)
    assert found.p_value == pytest.approx(np.mean(np.array(rhos) >= found.rho - 1e-9))


def test_many_pairs_use_students_t() -> None:
    rng = np.random.default_rng(0)
    first, second = rng.normal(size=(2, 30))
    found, expected = ranked(list(first), list(second)), spearmanr(first, second)
    assert (found.rho, found.p_value) == pytest.approx((expected.statistic, expected.pvalue))
    assert ranked(list(first), list(first)).p_value == pytest.approx(0.0, abs=1e-12)


def test_two_pairs_are_no_ranking() -> None:
    assert rank_correlation([1.0, 2.0], [1.0, 2.0]) is None
    with pytest.raises(InputError, match="the same length"):
        rank_correlation([1.0, 2.0, 3.0], [1.0, 2.0])


@pytest.mark.parametrize(("count", "p_value"), [(8, 2.0 / 40320.0), (9, 0.0)])
def test_eight_pairs_are_counted_and_nine_are_not(count: int, p_value: float) -> None:
    found = ranked(list(range(count)), list(range(count)))
    assert found.p_value == pytest.approx(p_value, rel=1e-9)
    assert found.pairs == count


def interval_between(error: float, *values: float, other: Sequence[float] = (1.0, 2.0, 3.0, 9.0)) -> Interval:
    return ranking_interval([Estimate(value, error, 4.0, 5, True) for value in values], other)


def test_the_order_of_sure_estimates_is_sure() -> None:
    found = interval_between(0.01, 1.0, 2.0, 3.0, 4.0)
    assert (found.value, found.low, found.high) == pytest.approx((1.0, 1.0, 1.0))
    assert (found.blocks, found.bounded) == (20, True)


def test_neighbours_whose_intervals_overlap_may_stand_the_other_way_round() -> None:
    """Intervals of 98.7 % for all four at once: t of 4 degrees of freedom is 4.28, so 0.13 m is 0.56 m to each side."""
    found = interval_between(0.13, 1.0, 2.0, 3.0, 4.0)
    swapped = 1.0 - 6.0 * 4.0 / (4.0 * 15.0)
    assert (found.value, found.low, found.high) == pytest.approx((1.0, swapped, 1.0)), "1 with 2, and 3 with 4"


def test_estimates_that_say_nothing_allow_every_order() -> None:
    found = interval_between(9.0, 1.0, 2.0, 3.0, 4.0)
    assert (found.value, found.low, found.high) == pytest.approx((1.0, -1.0, 1.0))
    assert interval_between(9.0, 2.0, 2.0, 2.0, 2.0).value == 0.0, "of equal values it says nothing"


def test_a_ranking_with_a_template_of_one_episode_or_with_too_many_has_no_bounds() -> None:
    estimates = [Estimate(1.0, 0.1, 4.0, 5, True), Estimate(2.0, 0.0, 0.0, 1, False), Estimate(3.0, 0.1, 4.0, 5, True)]
    assert not ranking_interval(estimates, [1.0, 2.0, 3.0]).bounded
    assert interval_between(0.1, *range(8), other=range(8)).bounded
    assert not interval_between(0.1, *range(9), other=range(9)).bounded
