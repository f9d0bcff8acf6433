import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from siren_ros.errors import InputError
from siren_ros.evaluation.statistics.block_bootstrap import draw_blocks, interval_of, interval_of_mean, times_drawn
from siren_ros.evaluation.statistics.block_sums import block_sums
from siren_ros.evaluation.statistics.interval import Interval

ONE_STRATUM = np.zeros(40, dtype=np.intp)


def rng(seed: int = 0) -> np.random.Generator:
    return np.random.default_rng(seed)


def test_a_resample_keeps_the_number_of_blocks_of_each_stratum() -> None:
    stratum = np.array([0, 1, 1, 2, 2, 2])
    drawn = draw_blocks(stratum, 500, rng())
    assert np.array_equal(stratum[drawn], np.broadcast_to(stratum, (500, 6)))
    assert set(drawn[:, 3].tolist()) == {3, 4, 5}
    times = times_drawn(stratum, 500, rng())
    assert np.array_equal(times, [[np.count_nonzero(row == block) for block in range(6)] for row in drawn])


def test_the_interval_of_many_equal_blocks_is_that_of_their_mean() -> None:
    """One value for each block: the interval is ±1.96 σ / √B, up to the bootstrap's own noise."""
    values = rng(4).normal(3.0, 2.0, 400)
    sums = block_sums(values, np.arange(400), np.zeros(400, dtype=np.intp))
    found = interval_of_mean(sums, rng(1), resamples=20_000)
    half = 1.96 * values.std() / 20.0
    assert found.value == pytest.approx(values.mean())
    assert found.low == pytest.approx(values.mean() - half, abs=0.02)
    assert found.high == pytest.approx(values.mean() + half, abs=0.02)
    assert found.blocks == 400


def test_two_blocks_have_three_resamples() -> None:
    """Means 1, 2 and 3 with probabilities 1/4, 1/2 and 1/4."""
    sums = block_sums(np.array([1.0, 3.0]), np.arange(2), np.zeros(2, dtype=np.intp))
    assert interval_of_mean(sums, rng()) == Interval(2.0, 1.0, 3.0, 2)
    assert interval_of_mean(sums, rng(), confidence=0.4) == Interval(2.0, 2.0, 2.0, 2)


def test_dependent_samples_within_blocks_widen_the_interval() -> None:
    """Ten copies of each value say no more than one; as if they were independent, they would."""
    values = rng(2).normal(size=40)
    copies = np.repeat(values, 10)
    once = interval_of_mean(block_sums(values, np.arange(40), ONE_STRATUM), rng(1))
    by_block = interval_of_mean(block_sums(copies, np.repeat(np.arange(40), 10), ONE_STRATUM), rng(1))
    by_sample = interval_of_mean(block_sums(copies, np.arange(400), np.zeros(400, dtype=np.intp)), rng(1))
    assert (by_block.low, by_block.high) == pytest.approx((once.low, once.high))
    assert by_sample.high - by_sample.low < 0.5 * (once.high - once.low)


def test_strata_count_once_and_values_within_a_stratum_are_pooled() -> None:
    values, block = np.array([1.0, 1.0, 1.0, 5.0, 10.0]), np.array([0, 0, 0, 1, 2])
    found = interval_of_mean(block_sums(values, block, np.array([0, 0, 1])), rng())
    assert found.value == pytest.approx((8.0 / 4.0 + 10.0) / 2.0)
    assert (found.low, found.high) == pytest.approx((5.5, 7.5)), "either block of the first stratum twice"


def test_a_root_is_taken_before_the_mean_over_strata() -> None:
    sums = block_sums(np.array([9.0, 16.0]), np.arange(2), np.arange(2), np.sqrt)
    assert interval_of_mean(sums, rng()).value == pytest.approx(3.5)


def test_a_stratum_of_one_block_leaves_the_mean_without_bounds() -> None:
    """Drawn within its stratum it is always the same: the interval would say that it does not scatter."""
    values, block = np.array([1.0, 2.0, 10.0]), np.array([0, 1, 2])
    found = interval_of_mean(block_sums(values, block, np.array([0, 0, 1])), rng())
    assert (found.valid, found.bounded) == (True, False)
    assert interval_of_mean(block_sums(values[:2], block[:2], np.array([0, 0, 1])), rng()).bounded


def test_blocks_without_values_do_not_count() -> None:
    values = np.array([np.nan, 2.0, 4.0, np.nan])
    sums = block_sums(values, np.array([0, 1, 2, 2]), np.zeros(5, dtype=np.intp))
    assert sums.count.tolist() == [0, 1, 1, 0, 0]
    assert interval_of_mean(sums, rng()) == Interval(3.0, 2.0, 4.0, 2)


def test_one_block_has_no_bounds_and_none_no_value() -> None:
    single = interval_of_mean(block_sums(np.array([1.0, 3.0]), np.zeros(2, int), np.zeros(1, int)), rng())
    assert (single.value, single.valid, single.bounded) == (2.0, True, False)
    none = interval_of_mean(block_sums(np.zeros(0), np.zeros(0, int), np.zeros(3, int)), rng())
    assert (none.valid, none.bounded) == (False, False)


@given(seed=st.integers(0, 1000))
def test_any_statistic_gives_what_the_mean_gives(seed: int) -> None:
    values = rng(seed).normal(size=12)
    stratum = np.zeros(12, dtype=np.intp)
    found = interval_of(lambda blocks: float(values[blocks].mean()), stratum, rng(seed), resamples=200)
    expected = interval_of_mean(block_sums(values, np.arange(12), stratum), rng(seed), resamples=200)
    assert (found.value, found.low, found.high) == pytest.approx((expected.value, expected.low, expected.high))
    assert found.low <= found.high


def test_a_statistic_without_blocks_is_not_computed() -> None:
    assert not interval_of(lambda _: 1.0 / 0.0, np.zeros(0, dtype=np.intp), rng()).valid


def test_the_same_seed_gives_the_same_interval() -> None:
    sums = block_sums(rng().normal(size=40), np.arange(40), ONE_STRATUM)
    assert interval_of_mean(sums, rng(3)) == interval_of_mean(sums, rng(3)) != interval_of_mean(sums, rng(4))


@pytest.mark.parametrize("wrong", [{"resamples": 0}, {"confidence": 1.0}, {"confidence": 0.0}])
def test_wrong_settings_are_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(InputError, match=next(iter(wrong))):
        interval_of_mean(block_sums(np.ones(40), np.arange(40), ONE_STRATUM), rng(), **wrong)
