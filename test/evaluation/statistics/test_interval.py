"""What an interval says, and when it says nothing."""

import numpy as np
import pytest

from siren_ros.errors import InputError
from siren_ros.evaluation.statistics.interval import NOTHING, Interval, percentile_interval


def test_two_blocks_bound_a_value_and_one_does_not() -> None:
    assert [Interval(1.0, 0.5, 1.5, blocks).bounded for blocks in (0, 1, 2)] == [False, False, True]
    assert [Interval(1.0, 0.5, 1.5, blocks).valid for blocks in (0, 1)] == [False, True]
    assert not Interval(1.0, 0.5, 1.5, 5, single=True).bounded
    assert not NOTHING.valid


def test_the_bounds_leave_out_as_much_on_either_side() -> None:
    """Of the values 0 to 100, 10 % on either side are outside of 80 %."""
    resampled, stratum = np.arange(101.0), np.zeros(4, dtype=np.intp)
    found = percentile_interval(40.0, resampled, stratum, 0.8)
    assert (found.low, found.high) == pytest.approx((10.0, 90.0))
    assert (found.value, found.blocks, found.single) == (40.0, 4, False)
    assert percentile_interval(40.0, resampled, stratum).low == pytest.approx(2.5)


@pytest.mark.parametrize(("stratum", "single"), [([0, 0, 1, 1], False), ([0, 0, 1], True), ([0], True)])
def test_a_stratum_of_one_block_is_told(stratum: list[int], *, single: bool) -> None:
    assert percentile_interval(1.0, np.arange(3.0), np.array(stratum)).single is single


def test_one_block_is_its_own_bounds() -> None:
    assert percentile_interval(1.5, np.arange(3.0), np.zeros(1, dtype=np.intp)) == Interval(1.5, 1.5, 1.5, 1, True)


@pytest.mark.parametrize("confidence", [0.0, 1.0, -0.5])
def test_all_and_nothing_are_no_confidence(confidence: float) -> None:
    with pytest.raises(InputError, match="between 0 and 1"):
        percentile_interval(1.0, np.arange(3.0), np.zeros(2, dtype=np.intp), confidence)
