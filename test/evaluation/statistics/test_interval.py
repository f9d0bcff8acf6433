"""What an interval says, and when it says nothing."""

import numpy as np
import pytest
from scipy.stats import binom, binomtest

from siren_ros.evaluation.statistics.interval import (
    BLOCKS_MIN,
    NOTHING,
    Interval,
    lack_of_bounds,
    mean_of_intervals,
    share_interval,
)


def test_five_blocks_bound_a_value_and_four_do_not() -> None:
    assert [Interval(1.0, 0.5, 1.5, blocks).bounded for blocks in (0, 1, 4, 5)] == [False, False, False, True]
    assert [Interval(1.0, 0.5, 1.5, blocks).valid for blocks in (0, 1)] == [False, True]
    assert not Interval(1.0, 0.5, 1.5, 5, scatter_known=False).bounded
    assert not NOTHING.valid


@pytest.mark.parametrize(("part", "whole"), [(0, 5), (3, 5), (20, 20), (17, 40)])
@pytest.mark.parametrize("confidence", [0.8, 0.95])
def test_a_share_has_wilsons_interval(part: int, whole: int, confidence: float) -> None:
    found = share_interval(part, whole, confidence)
    expected = binomtest(part, whole).proportion_ci(confidence, method="wilson")
    assert (found.low, found.high) == pytest.approx((expected.low, expected.high), abs=1e-12)
    assert (found.value, found.blocks) == (part / whole, whole)
    assert share_interval(0, 0, confidence) == NOTHING


@pytest.mark.parametrize("whole", [5, 10, 20, 40])
def test_the_interval_of_a_share_holds_it_in_about_95_percent(whole: int) -> None:
    """Over all true shares, with the probability of each count: the bootstrap of 0 of 5 has no width at all."""
    bounds = [share_interval(part, whole) for part in range(whole + 1)]
    held = [
        sum(binom.pmf(part, whole, share) for part, one in enumerate(bounds) if one.low <= share <= one.high)
        for share in np.linspace(0.02, 0.98, 97)
    ]
    assert 0.94 < np.mean(held) < 0.97
    assert min(held) > 0.82


def test_a_mean_of_shares_is_surer_than_each() -> None:
    """Of three equal parts each distance is divided by √3; what was not measured does not count."""
    one = share_interval(12, 20)
    found = mean_of_intervals([one, NOTHING, one, one], 60)
    assert (found.value, found.blocks) == (pytest.approx(0.6), 60)
    assert found.low == pytest.approx(0.6 - (0.6 - one.low) / np.sqrt(3.0))
    assert found.high == pytest.approx(0.6 + (one.high - 0.6) / np.sqrt(3.0))
    assert mean_of_intervals([NOTHING], 3) == NOTHING
    assert mean_of_intervals([share_interval(5, 5), share_interval(9, 9)], 14).high == 1.0


def test_what_a_dash_stands_for_is_told_once_and_where_there_is_one() -> None:
    sure = Interval(1.0, 0.5, 1.5, BLOCKS_MIN)
    few = Interval(1.0, 0.5, 1.5, 4)
    assert lack_of_bounds([sure, NOTHING]) == []
    assert lack_of_bounds([few, sure, few]) == [
        "[-] is no interval: it takes 5 episodes, 2 of each template, and values that are not all the same"
    ]
