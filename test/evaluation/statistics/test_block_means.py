import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import t as student
from scipy.stats import ttest_1samp, ttest_ind, ttest_rel

from siren_ros.errors import InputError
from siren_ros.evaluation.statistics.block_means import (
    BlockSums,
    Estimate,
    PairedDifference,
    block_sums,
    estimate_of_mean,
    holm,
    interval_of_mean,
    jackknife,
    paired_difference,
)
from siren_ros.tables.interval import NOTHING


def test_four_tests_one_and_none() -> None:
    assert holm([0.01, 0.04, 0.03, 0.005]) == pytest.approx([0.03, 0.06, 0.06, 0.02])
    assert holm([0.2]) == [0.2]
    assert holm([]) == []


@given(st.lists(st.floats(0.0, 1.0), min_size=1, max_size=8))
def test_adjusted_values_are_no_smaller_and_keep_the_order(values: list[float]) -> None:
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
    found = interval_of_mean(one_each(values, [0, 0, 0, 0, 0, 1]))
    assert (found.valid, found.bounded) == (True, False)
    assert interval_of_mean(one_each(values, [0, 0, 0, 0, 1, 1])).bounded


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


def compared(first: npt.ArrayLike, second: npt.ArrayLike, seed: int = 0) -> PairedDifference:
    """Two models with one value in each block."""
    return paired_difference(one_each(first), one_each(second), rng(seed))


def test_a_constant_difference_has_no_width() -> None:
    """However much the blocks differ: of eight blocks, 2 of the 256 exchanges give as large a difference."""
    values = rng().normal(0.0, 100.0, 8)
    found = compared(values, (values + 0.5), 1)
    assert (found.difference.value, found.difference.low, found.difference.high) == pytest.approx((-0.5, -0.5, -0.5))
    assert found.p_value == pytest.approx(2.0 / 256.0)


def test_the_interval_is_that_of_the_differences() -> None:
    first, second = rng(3).normal(size=(2, 9))
    found = compared(first, second).difference
    expected = ttest_rel(first, second).confidence_interval()
    assert (found.low, found.high) == pytest.approx((expected.low, expected.high))


def test_one_block_against_the_others_is_no_evidence() -> None:
    """Differences 3, −1, −1, −1: the mean is 0."""
    found = compared([3.0, 0.0, 0.0, 0.0], [0.0, 1.0, 1.0, 1.0])
    assert found.difference.value == pytest.approx(0.0)
    assert found.p_value == 1.0


def test_p_value_by_hand() -> None:
    """Differences 1, 2, 4: sums ±1 ± 2 ± 4; 7 is reached by 2 of 8, and 1 + 2 − 4 = −1 by all."""
    assert compared([1.0, 2.0, 4.0], [0.0, 0.0, 0.0]).p_value == pytest.approx(0.25)
    assert compared([1.0, 2.0, 0.0], [0.0, 0.0, 4.0]).p_value == pytest.approx(1.0)


def test_models_that_are_alike_are_seldom_told_apart() -> None:
    """Under no difference, p is below 0.05 in 5 % of the cases; 30 blocks take random exchanges."""
    below = sum(compared(*rng(seed).normal(size=(2, 30)), seed).p_value < 0.05 for seed in range(300))
    assert 3 <= below <= 30


@given(seed=st.integers(0, 1000), blocks=st.integers(2, 16))
def test_exchanged_models_have_the_opposite_difference(seed: int, blocks: int) -> None:
    first, second = rng(seed).normal(size=(2, blocks))
    there, back = compared(first, second, seed), compared(second, first, seed)
    assert there.difference.value == pytest.approx(-back.difference.value)
    assert there.difference.low == pytest.approx(-back.difference.high)
    assert there.p_value == pytest.approx(back.p_value)


def test_roots_of_means_can_be_compared() -> None:
    stratum = np.zeros(8, dtype=np.intp)
    first, second = (block_sums(np.full(8, square), np.arange(8), stratum, np.sqrt) for square in (9.0, 16.0))
    found = paired_difference(first, second, rng())
    assert found.difference.value == pytest.approx(-1.0)
    assert found.p_value == pytest.approx(2.0 / 256.0)


def test_one_block_or_none_tells_nothing() -> None:
    assert compared([1.0], [2.0]).p_value == 1.0
    nothing = compared([np.nan, np.nan], [np.nan, np.nan])
    assert not nothing.difference.valid
    assert nothing.p_value == 1.0


def test_other_samples_cannot_be_paired() -> None:
    with pytest.raises(InputError, match="the same samples in every block"):
        compared([1.0, np.nan], [1.0, 2.0])


def test_random_exchanges_count_the_one_found_too() -> None:
    """13 blocks are one more than are enumerated: the same 4096 exchanges, and the pair as it is."""
    values = np.array([3.0, -1.0, 4.0, 1.0, -5.0, 9.0, 2.0, -6.0, 5.0, 3.0, 5.0, -8.0, 9.0])
    found = compared(values, np.zeros(13), 7)
    signs = np.where(rng(7).random((4096, 13)) < 0.5, -1.0, 1.0)
    as_far = np.count_nonzero(np.abs(signs @ values) >= abs(values.sum()) - 1e-9)
    assert found.p_value == pytest.approx((as_far + 1) / 4097)
    assert 0.1 < found.p_value < 0.5


def test_twelve_blocks_are_enumerated() -> None:
    assert compared(np.ones(12), np.zeros(12)).p_value == 2.0 / 4096.0
