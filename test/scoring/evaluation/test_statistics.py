"""Intervals, differences and rank correlations, by hand and by other programs."""

from collections.abc import Callable, Sequence
from itertools import permutations

import numpy as np
import numpy.typing as npt
import pytest
import scipy
from hypothesis import given, settings
from hypothesis import strategies as st

from siren_ros.base.tables import NOTHING, Interval
from siren_ros.errors import InputError
from siren_ros.scoring.evaluation.risk.scoring import balanced_accuracy, f1, macro_f1
from siren_ros.scoring.evaluation.statistics import (
    BlockSums,
    Estimate,
    block_sums,
    estimate_of_mean,
    holm,
    interval_of_mean,
    jackknife,
    paired_difference,
    rank_correlation,
    ranking_interval,
)


def test_four_tests_one_and_none() -> None:
    assert holm([0.01, 0.04, 0.03, 0.005]) == pytest.approx([0.03, 0.06, 0.06, 0.02])
    assert holm([0.2]) == [0.2]
    assert holm([]) == []


@given(st.lists(st.floats(0.0, 1.0), min_size=1, max_size=8))
def test_adjusted_values_are_no_smaller_and_keep_the_order(values) -> None:
    adjusted = holm(values)
    assert all(new >= value for value, new in zip(values, adjusted, strict=True))
    order = sorted(range(len(values)), key=lambda index: values[index])
    assert [adjusted[index] for index in order] == sorted(adjusted)


ONE_STRATUM = np.zeros(40, dtype=np.intp)


def rng(seed: int = 0) -> np.random.Generator:
    return np.random.default_rng(seed)


def one_each(values: npt.ArrayLike, stratum: npt.ArrayLike = 0) -> BlockSums:
    """One value in each block."""
    values = np.asarray(values, dtype=np.float64)
    block = np.arange(len(values))
    return block_sums(values, block, np.broadcast_to(np.asarray(stratum, dtype=np.intp), block.shape))


@given(seed=st.integers(0, 1000), blocks=st.integers(2, 30), confidence=st.floats(0.5, 0.99))
def test_one_value_in_each_block_has_students_interval(seed, blocks, confidence) -> None:
    values = rng(seed).normal(3.0, 2.0, blocks)
    interval = interval_of_mean(one_each(values), confidence)
    expected = scipy.stats.ttest_1samp(values, 0.0).confidence_interval(confidence)
    assert interval.value == pytest.approx(values.mean())
    assert (interval.low, interval.high) == pytest.approx((expected.low, expected.high))
    assert interval.blocks == blocks


def test_two_strata_have_welchs_degrees_of_freedom() -> None:
    """Half the difference of two means is the mean of the one and of the other with its sign turned."""
    first, second = rng(1).normal(0.0, 1.0, 6), rng(2).normal(2.0, 5.0, 9)
    stratum = np.repeat([0, 1], [6, 9])
    estimate = estimate_of_mean(one_each(np.concatenate((first, -second)), stratum))
    expected = scipy.stats.ttest_ind(first, second, equal_var=False)
    assert estimate.degrees == pytest.approx(expected.df)
    assert estimate.value / estimate.error == pytest.approx(expected.statistic)


def test_a_ratio_of_sums_scatters_as_its_residuals() -> None:
    """Blocks of many sizes: nearly the linearised error √(B/(B−1) Σ (total − ratio · count)²) / Σ count."""
    count = rng(5).integers(50, 400, 60).astype(np.float64)
    total = count * rng(6).normal(2.0, 0.5, 60)
    estimate = estimate_of_mean(BlockSums(total, count, np.zeros(60, dtype=np.intp)))
    residual = total - estimate.value * count
    assert estimate.error == pytest.approx(np.sqrt(60 / 59 * (residual**2).sum()) / count.sum(), rel=0.02)
    assert estimate.degrees == pytest.approx(59.0)


def test_dependent_samples_within_blocks_widen_the_interval() -> None:
    """Ten copies of each value say no more than one; as if they were independent, they would."""
    values = rng(2).normal(size=40)
    copies = np.repeat(values, 10)
    once = interval_of_mean(block_sums(values, np.arange(40), ONE_STRATUM))
    by_block = interval_of_mean(block_sums(copies, np.repeat(np.arange(40), 10), ONE_STRATUM))
    by_sample = interval_of_mean(block_sums(copies, np.arange(400), np.zeros(400, dtype=np.intp)))
    assert (by_block.low, by_block.high) == pytest.approx((once.low, once.high))
    assert by_sample.high - by_sample.low < 0.5 * (once.high - once.low)


def test_strata_count_once_and_values_within_a_stratum_are_pooled() -> None:
    """Left out: 5, or 1 1 1, of the first stratum, whose mean is 2; 10 or 14 of the second."""
    values, block = np.array([1.0, 1.0, 1.0, 5.0, 10.0, 14.0]), np.array([0, 0, 0, 1, 2, 3])
    sums = block_sums(values, block, np.array([4, 4, 7, 7]))
    assert sums.value() == pytest.approx((2.0 + 12.0) / 2.0)
    assert sums.left_out() == pytest.approx([8.5, 6.5, 8.0, 6.0])
    estimate = estimate_of_mean(sums)
    assert estimate.error == pytest.approx(np.sqrt(0.5 * (1.0 + 1.0) + 0.5 * (1.0 + 1.0)))
    assert estimate.degrees == pytest.approx(2.0)


def test_a_root_is_taken_before_the_mean_over_strata() -> None:
    squares = np.array([9.0, 16.0, 25.0, 49.0])
    sums = block_sums(squares, np.arange(4), np.array([0, 0, 1, 1]), np.sqrt)
    first, second = np.sqrt([12.5, 37.0])
    assert sums.value() == pytest.approx((first + second) / 2)
    assert sums.left_out() == pytest.approx(np.array([4.0 + second, 3.0 + second, first + 7.0, first + 5.0]) / 2)


def test_a_stratum_of_one_block_leaves_the_mean_without_bounds() -> None:
    """How it scatters is not known: the interval would say that it does not."""
    values = np.arange(6.0)
    interval = interval_of_mean(one_each(values, [0, 0, 0, 0, 0, 1]))
    assert (interval.valid, interval.bounded) == (True, False)
    assert interval_of_mean(one_each(values, [0, 0, 0, 0, 1, 1])).bounded


def test_blocks_that_all_say_the_same_and_an_estimate_that_is_none_without_one_have_no_bounds() -> None:
    """Twenty episodes without a collision do not say that there is none."""
    interval = interval_of_mean(one_each(np.zeros(20)))
    assert (interval.value, interval.low, interval.high, interval.bounded) == (0.0, 0.0, 0.0, False)
    assert interval_of_mean(one_each(np.array([0.1 + 0.2, 0.3, 0.3, 0.3, 0.3]))).bounded is False, "up to rounding"
    estimate = jackknife(0.5, np.array([0.4, 0.6, 0.5, 0.5, np.nan]), np.zeros(5, dtype=np.intp))
    assert not estimate.interval().bounded


def test_blocks_without_values_do_not_count() -> None:
    values, block = np.array([1.0, 2.0, 3.0, 4.0, 5.0, np.nan]), np.array([0, 2, 3, 4, 5, 6])
    interval = interval_of_mean(block_sums(values, block, np.zeros(8, dtype=np.intp)))
    assert (interval.value, interval.blocks, interval.bounded) == (3.0, 5, True)
    assert interval_of_mean(block_sums(np.zeros(0), np.zeros(0, int), np.zeros(3, int))) == NOTHING
    assert not interval_of_mean(block_sums(np.ones(2), np.zeros(2, int), np.zeros(1, int))).bounded


def test_draws_are_students() -> None:
    estimate = Estimate(3.0, 2.0, 4.0, 5, True).draws(20_000, rng())
    assert np.median(estimate) == pytest.approx(3.0, abs=0.05)
    assert np.quantile(estimate, 0.975) == pytest.approx(3.0 + 2.0 * scipy.stats.t.ppf(0.975, 4.0), rel=0.05)


@pytest.mark.parametrize("confidence", [0.0, 1.0, -0.5])
def test_all_and_nothing_are_no_confidence(confidence) -> None:
    with pytest.raises(InputError, match="between 0 and 1"):
        interval_of_mean(one_each(np.arange(5.0)), confidence)


def compared(first: npt.ArrayLike, second: npt.ArrayLike, seed: int = 0) -> tuple[Interval, float]:
    """Two models with one value in each block."""
    return paired_difference(one_each(first), one_each(second), rng(seed))


def test_a_constant_difference_has_no_width() -> None:
    """However much the blocks differ: of eight blocks, 2 of the 256 exchanges give as large a difference."""
    values = rng().normal(0.0, 100.0, 8)
    interval, p_value = compared(values, (values + 0.5), 1)
    assert (interval.value, interval.low, interval.high) == pytest.approx((-0.5, -0.5, -0.5))
    assert p_value == pytest.approx(2.0 / 256.0)


def test_the_interval_is_that_of_the_differences() -> None:
    first, second = rng(3).normal(size=(2, 9))
    comparison, _ = compared(first, second)
    expected = scipy.stats.ttest_rel(first, second).confidence_interval()
    assert (comparison.low, comparison.high) == pytest.approx((expected.low, expected.high))


def test_p_value_by_hand() -> None:
    """Differences 1, 2, 4: sums ±1 ± 2 ± 4; 7 is reached by 2 of 8, and 1 + 2 − 4 = −1 by all."""
    assert compared([1.0, 2.0, 4.0], [0.0, 0.0, 0.0])[1] == pytest.approx(0.25)
    assert compared([1.0, 2.0, 0.0], [0.0, 0.0, 4.0])[1] == pytest.approx(1.0)
    assert compared(np.ones(12), np.zeros(12))[1] == 2.0 / 4096.0
    difference, p_value = compared([3.0, 0.0, 0.0, 0.0], [0.0, 1.0, 1.0, 1.0])
    assert (difference.value, p_value) == pytest.approx((0.0, 1.0))


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 1000), blocks=st.integers(2, 16))
def test_exchanged_models_have_the_opposite_difference(seed, blocks) -> None:
    first, second = rng(seed).normal(size=(2, blocks))
    (there, p_there), (back, p_back) = compared(first, second, seed), compared(second, first, seed)
    assert there.value == pytest.approx(-back.value)
    assert there.low == pytest.approx(-back.high)
    assert p_there == pytest.approx(p_back)


def test_roots_of_means_can_be_compared() -> None:
    stratum = np.zeros(8, dtype=np.intp)
    first, second = (block_sums(np.full(8, square), np.arange(8), stratum, np.sqrt) for square in (9.0, 16.0))
    difference, p_value = paired_difference(first, second, rng())
    assert difference.value == pytest.approx(-1.0)
    assert p_value == pytest.approx(2.0 / 256.0)


def test_one_block_or_none_tells_nothing() -> None:
    assert compared([1.0], [2.0])[1] == 1.0
    assert compared([np.nan, np.nan], [np.nan, np.nan]) == (NOTHING, 1.0)


def test_other_samples_cannot_be_paired() -> None:
    with pytest.raises(InputError, match="the same samples in every block"):
        compared([1.0, np.nan], [1.0, 2.0])


def test_random_exchanges_count_the_one_found_too() -> None:
    """13 blocks are one more than are enumerated: the same 4096 exchanges, and the pair as it is."""
    values = np.array([3.0, -1.0, 4.0, 1.0, -5.0, 9.0, 2.0, -6.0, 5.0, 3.0, 5.0, -8.0, 9.0])
    _, p_value = compared(values, np.zeros(13), 7)
    signs = np.where(rng(7).random((4096, 13)) < 0.5, -1.0, 1.0)
    as_far = np.count_nonzero(np.abs(signs @ values) >= abs(values.sum()) - 1e-9)
    assert p_value == pytest.approx((as_far + 1) / 4097)
    assert 0.1 < p_value < 0.5


@given(st.lists(st.tuples(st.integers(0, 4), st.integers(0, 4)), min_size=3, max_size=10))
def test_rank_correlation_is_spearmans(pairs) -> None:
    first, second = (list(map(float, side)) for side in zip(*pairs, strict=True))
    if len(set(first)) == 1 or len(set(second)) == 1:
        assert rank_correlation(first, second) is None
    else:
        assert rank_correlation(first, second).rho == pytest.approx(
            scipy.stats.spearmanr(first, second).statistic, abs=1e-12
        )
        assert rank_correlation(first, second).pairs == len(pairs)


def test_the_p_value_counts_the_orders() -> None:
    first, second = [1.0, 2.0, 3.0, 4.0, 5.0], [1.0, 3.0, 2.0, 5.0, 4.0]
    rhos = [abs(scipy.stats.spearmanr(first, order).statistic) for order in permutations(second)]
    correlation = rank_correlation(first, second)
    assert correlation.p_value == pytest.approx(np.mean(np.array(rhos) >= correlation.rho - 1e-9))


def test_many_pairs_use_students_t() -> None:
    rng = np.random.default_rng(0)
    first, second = rng.normal(size=(2, 30))
    correlation, expected = rank_correlation(list(first), list(second)), scipy.stats.spearmanr(first, second)
    assert (correlation.rho, correlation.p_value) == pytest.approx((expected.statistic, expected.pvalue))


def test_two_pairs_are_no_ranking() -> None:
    assert rank_correlation([1.0, 2.0], [1.0, 2.0]) is None
    with pytest.raises(InputError, match="the same length"):
        rank_correlation([1.0, 2.0, 3.0], [1.0, 2.0])


@pytest.mark.parametrize(("count", "p_value"), [(8, 2.0 / 40320.0), (9, 0.0)])
def test_eight_pairs_are_counted_and_nine_are_not(count, p_value) -> None:
    correlation = rank_correlation(list(range(count)), list(range(count, 0, -1)))
    assert (correlation.rho, correlation.p_value) == pytest.approx((-1.0, p_value), rel=1e-9)
    assert correlation.pairs == count


def interval_between(error: float, *values: float, other: Sequence[float] = (1.0, 2.0, 3.0, 9.0)) -> Interval:
    return ranking_interval([Estimate(value, error, 4.0, 5, True) for value in values], other)


@pytest.mark.parametrize(("error", "low"), [(0.01, 1.0), (0.13, 1.0 - 6.0 * 4.0 / (4.0 * 15.0)), (9.0, -1.0)])
def test_estimates_whose_intervals_overlap_may_stand_the_other_way_round(error, low) -> None:
    """Intervals of 98.7 % for all four at once: t of 4 degrees of freedom is 4.28, so 0.13 m is 0.56 m to each side.

    Then 1 may change places with 2, and 3 with 4.
    """
    pet = interval_between(error, 1.0, 2.0, 3.0, 4.0)
    assert (pet.value, pet.low, pet.high) == pytest.approx((1.0, low, 1.0))
    assert (pet.blocks, pet.bounded) == (20, True)
    assert interval_between(9.0, 2.0, 2.0, 2.0, 2.0).value == 0.0, "of equal values it says nothing"


def test_a_ranking_with_a_template_of_one_episode_or_with_too_many_has_no_bounds() -> None:
    estimates = [Estimate(1.0, 0.1, 4.0, 5, True), Estimate(2.0, 0.0, 0.0, 1, False), Estimate(3.0, 0.1, 4.0, 5, True)]
    assert not ranking_interval(estimates, [1.0, 2.0, 3.0]).bounded
    assert interval_between(0.1, *range(8), other=range(8)).bounded
    assert not interval_between(0.1, *range(9), other=range(9)).bounded


TRIALS = 600
"""The share of hits is known up to ±0.02 (two standard errors)."""
Means = Callable[[np.random.Generator, int], np.ndarray]


def normal(rng: np.random.Generator, episodes: int) -> np.ndarray:
    return rng.normal(2.0, 0.8, episodes)


def skewed(rng: np.random.Generator, episodes: int) -> np.ndarray:
    """Of mean 2."""
    return 2.0 * rng.lognormal(-0.125, 0.5, episodes)


def sums_of(rng: np.random.Generator, means: Means, episodes: int) -> BlockSums:
    count = rng.integers(50, 400, episodes).astype(np.float64)
    return BlockSums(means(rng, episodes) * count, count, np.zeros(episodes, dtype=np.intp))


def coverage(interval_of: Callable[[np.random.Generator], Interval], true: float) -> float:
    intervals = [interval_of(np.random.default_rng(seed)) for seed in range(TRIALS)]
    return float(np.mean([interval.low <= true <= interval.high for interval in intervals]))


@pytest.mark.parametrize("episodes", [5, 20])
@pytest.mark.parametrize(("means", "least"), [(normal, 0.92), (skewed, 0.88)])
def test_a_mean_over_the_samples_of_episodes(episodes, means, least) -> None:
    held = coverage(lambda rng: interval_of_mean(sums_of(rng, means, episodes)), 2.0)
    assert least < held < 0.97


@pytest.mark.parametrize("score", [balanced_accuracy, macro_f1, lambda counts: f1(counts, 1)])
def test_scores_of_risk(score) -> None:
    """A model that is right in 75, 50 and 50 % of normal videos, near-misses and collisions, at the paper's balance."""
    answers = np.array([[0.75, 0.15, 0.1, 0.0], [0.3, 0.5, 0.2, 0.0], [0.2, 0.3, 0.5, 0.0]])
    shares = np.array([[0.705], [0.238], [0.057]]) * answers
    true = score(np.rint(shares * 1e6).astype(np.int64)).value

    def interval_of(rng: np.random.Generator) -> Interval:
        return score(rng.multinomial(20, shares.ravel()).reshape(3, 4))

    assert 0.89 < coverage(interval_of, true) < 0.98
