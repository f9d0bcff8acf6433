"""Closed forms of the jackknife. How often its intervals hold the true value is counted in ``test_coverage.py``."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import t as student
from scipy.stats import ttest_1samp, ttest_ind

from siren_ros.errors import InputError
from siren_ros.evaluation.statistics.block_sums import BlockSums, block_sums
from siren_ros.evaluation.statistics.interval import NOTHING
from siren_ros.evaluation.statistics.jackknife import Estimate, estimate_of_mean, interval_of_mean, jackknife

ONE_STRATUM = np.zeros(40, dtype=np.intp)


def rng(seed: int = 0) -> np.random.Generator:
    return np.random.default_rng(seed)


def one_each(values: np.ndarray, stratum: np.ndarray | None = None) -> BlockSums:
    """One value in each block."""
    blocks = len(values)
    return block_sums(values, np.arange(blocks), np.zeros(blocks, dtype=np.intp) if stratum is None else stratum)


@given(seed=st.integers(0, 1000), blocks=st.integers(2, 30), confidence=st.floats(0.5, 0.99))
def test_one_value_in_each_block_has_students_interval(seed: int, blocks: int, confidence: float) -> None:
    values = rng(seed).normal(3.0, 2.0, blocks)
    found = interval_of_mean(one_each(values), confidence)
    expected = ttest_1samp(values, 0.0).confidence_interval(confidence)
    assert found.value == pytest.approx(values.mean())
    assert (found.low, found.high) == pytest.approx((expected.low, expected.high))
    assert found.blocks == blocks


def test_two_strata_have_welchs_degrees_of_freedom() -> None:
    """Half the difference of two means is the mean of the one and of the other with its sign turned."""
    first, second = rng(1).normal(0.0, 1.0, 6), rng(2).normal(2.0, 5.0, 9)
    stratum = np.repeat([0, 1], [6, 9])
    found = estimate_of_mean(one_each(np.concatenate((first, -second)), stratum))
    expected = ttest_ind(first, second, equal_var=False)
    assert found.degrees == pytest.approx(expected.df)
    assert found.value / found.error == pytest.approx(expected.statistic)


def test_a_ratio_of_sums_scatters_as_its_residuals() -> None:
    """Blocks of many sizes: nearly the linearised error √(B/(B−1) Σ (total − ratio · count)²) / Σ count."""
    count = rng(5).integers(50, 400, 60).astype(np.float64)
    total = count * rng(6).normal(2.0, 0.5, 60)
    found = estimate_of_mean(BlockSums(total, count, np.zeros(60, dtype=np.intp)))
    residual = total - found.value * count
    assert found.error == pytest.approx(np.sqrt(60 / 59 * (residual**2).sum()) / count.sum(), rel=0.02)
    assert found.degrees == pytest.approx(59.0)


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
    found = estimate_of_mean(sums)
    assert found.error == pytest.approx(np.sqrt(0.5 * (1.0 + 1.0) + 0.5 * (1.0 + 1.0)))
    assert found.degrees == pytest.approx(2.0)


def test_a_root_is_taken_before_the_mean_over_strata() -> None:
    squares = np.array([9.0, 16.0, 25.0, 49.0])
    sums = block_sums(squares, np.arange(4), np.array([0, 0, 1, 1]), np.sqrt)
    roots = np.sqrt([12.5, 37.0])
    assert sums.value() == pytest.approx(roots.mean())
    assert sums.left_out() == pytest.approx(
        [(4.0 + roots[1]) / 2, (3.0 + roots[1]) / 2, (roots[0] + 7.0) / 2, (roots[0] + 5.0) / 2]
    )


def test_a_stratum_of_one_block_leaves_the_mean_without_bounds() -> None:
    """How it scatters is not known: the interval would say that it does not."""
    values = np.arange(6.0)
    found = interval_of_mean(one_each(values, np.array([0, 0, 0, 0, 0, 1])))
    assert (found.valid, found.bounded) == (True, False)
    assert interval_of_mean(one_each(values, np.array([0, 0, 0, 0, 1, 1]))).bounded


def test_blocks_that_all_say_the_same_have_no_bounds() -> None:
    """Twenty episodes without a collision do not say that there is none."""
    found = interval_of_mean(one_each(np.zeros(20)))
    assert (found.value, found.low, found.high, found.bounded) == (0.0, 0.0, 0.0, False)
    assert interval_of_mean(one_each(np.array([0.1 + 0.2, 0.3, 0.3, 0.3, 0.3]))).bounded is False, "up to rounding"


def test_an_estimate_that_is_none_without_a_block_has_no_bounds() -> None:
    found = jackknife(0.5, np.array([0.4, 0.6, 0.5, 0.5, np.nan]), np.zeros(5, dtype=np.intp))
    assert not found.interval().bounded


def test_blocks_without_values_do_not_count() -> None:
    values, block = np.array([1.0, 2.0, 3.0, 4.0, 5.0, np.nan]), np.array([0, 2, 3, 4, 5, 6])
    found = interval_of_mean(block_sums(values, block, np.zeros(8, dtype=np.intp)))
    assert (found.value, found.blocks, found.bounded) == (3.0, 5, True)
    assert interval_of_mean(block_sums(np.zeros(0), np.zeros(0, int), np.zeros(3, int))) == NOTHING
    assert not interval_of_mean(block_sums(np.ones(2), np.zeros(2, int), np.zeros(1, int))).bounded


def test_draws_are_students() -> None:
    found = Estimate(3.0, 2.0, 4.0, 5, True).draws(20_000, rng())
    assert np.median(found) == pytest.approx(3.0, abs=0.05)
    assert np.quantile(found, 0.975) == pytest.approx(3.0 + 2.0 * student.ppf(0.975, 4.0), rel=0.05)


@pytest.mark.parametrize("confidence", [0.0, 1.0, -0.5])
def test_all_and_nothing_are_no_confidence(confidence: float) -> None:
    with pytest.raises(InputError, match="between 0 and 1"):
        interval_of_mean(one_each(np.arange(5.0)), confidence)
