import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import ttest_rel

from siren_ros.errors import InputError
from siren_ros.evaluation.statistics.block_sums import BlockSums, block_sums
from siren_ros.evaluation.statistics.paired_difference import paired_difference


def one_each(*values: float) -> BlockSums:
    """One value in each block."""
    return block_sums(np.array(values), np.arange(len(values)), np.zeros(len(values), dtype=np.intp))


def rng(seed: int = 0) -> np.random.Generator:
    return np.random.default_rng(seed)


def test_a_constant_difference_has_no_width() -> None:
    """However much the blocks differ: of eight blocks, 2 of the 256 exchanges give as large a difference."""
    values = rng().normal(0.0, 100.0, 8)
    found = paired_difference(one_each(*values), one_each(*(values + 0.5)), rng(1))
    assert (found.difference.value, found.difference.low, found.difference.high) == pytest.approx((-0.5, -0.5, -0.5))
    assert found.p_value == pytest.approx(2.0 / 256.0)


def test_the_interval_is_that_of_the_differences() -> None:
    first, second = rng(3).normal(size=(2, 9))
    found = paired_difference(one_each(*first), one_each(*second), rng()).difference
    expected = ttest_rel(first, second).confidence_interval()
    assert (found.low, found.high) == pytest.approx((expected.low, expected.high))


def test_one_block_against_the_others_is_no_evidence() -> None:
    """Differences 3, −1, −1, −1: the mean is 0."""
    found = paired_difference(one_each(3.0, 0.0, 0.0, 0.0), one_each(0.0, 1.0, 1.0, 1.0), rng())
    assert found.difference.value == pytest.approx(0.0)
    assert found.p_value == 1.0


def test_p_value_by_hand() -> None:
    """Differences 1, 2, 4: sums ±1 ± 2 ± 4; 7 is reached by 2 of 8, and 1 + 2 − 4 = −1 by all."""
    assert paired_difference(one_each(1.0, 2.0, 4.0), one_each(0.0, 0.0, 0.0), rng()).p_value == pytest.approx(0.25)
    assert paired_difference(one_each(1.0, 2.0, 0.0), one_each(0.0, 0.0, 4.0), rng()).p_value == pytest.approx(1.0)


def test_models_that_are_alike_are_seldom_told_apart() -> None:
    """Under no difference, p is below 0.05 in 5 % of the cases; 30 blocks take random exchanges."""
    below = 0
    for seed in range(300):
        first, second = rng(seed).normal(size=(2, 30))
        below += paired_difference(one_each(*first), one_each(*second), rng(seed)).p_value < 0.05
    assert 3 <= below <= 30


@given(seed=st.integers(0, 1000), blocks=st.integers(2, 16))
def test_exchanged_models_have_the_opposite_difference(seed: int, blocks: int) -> None:
    first, second = (one_each(*values) for values in rng(seed).normal(size=(2, blocks)))
    there, back = (paired_difference(*pair, rng(seed)) for pair in ((first, second), (second, first)))
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
    assert paired_difference(one_each(1.0), one_each(2.0), rng()).p_value == 1.0
    nothing = paired_difference(one_each(np.nan, np.nan), one_each(np.nan, np.nan), rng())
    assert not nothing.difference.valid
    assert nothing.p_value == 1.0


def test_other_samples_cannot_be_paired() -> None:
    with pytest.raises(InputError, match="the same samples in every block"):
        paired_difference(one_each(1.0, np.nan), one_each(1.0, 2.0), rng())


def test_random_exchanges_count_the_one_found_too() -> None:
    """13 blocks are one more than are enumerated: the same 4096 exchanges, and the pair as it is."""
    values = np.array([3.0, -1.0, 4.0, 1.0, -5.0, 9.0, 2.0, -6.0, 5.0, 3.0, 5.0, -8.0, 9.0])
    found = paired_difference(one_each(*values), one_each(*np.zeros(13)), rng(7))
    signs = np.where(rng(7).random((4096, 13)) < 0.5, -1.0, 1.0)
    as_far = np.count_nonzero(np.abs(signs @ values) >= abs(values.sum()) - 1e-9)
    assert found.p_value == pytest.approx((as_far + 1) / 4097)
    assert 0.1 < found.p_value < 0.5


def test_twelve_blocks_are_enumerated() -> None:
    assert paired_difference(one_each(*np.ones(12)), one_each(*np.zeros(12)), rng()).p_value == 2.0 / 4096.0
