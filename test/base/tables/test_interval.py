"""What an interval says, and when it says nothing."""

import numpy as np
import pytest
import scipy

from siren_ros.base.tables.interval import NOTHING, Interval, interval_of_json, mean_of_intervals, share_interval


def test_five_blocks_bound_a_value_and_four_do_not() -> None:
    assert [Interval(1.0, 0.5, 1.5, blocks).bounded for blocks in (0, 1, 4, 5)] == [False, False, False, True]
    assert [Interval(1.0, 0.5, 1.5, blocks).valid for blocks in (0, 1)] == [False, True]
    assert not Interval(1.0, 0.5, 1.5, 5, scatter_known=False).bounded
    assert not NOTHING.valid


@pytest.mark.parametrize(("part", "whole"), [(0, 5), (3, 5), (20, 20), (17, 40)])
@pytest.mark.parametrize("confidence", [0.8, 0.95])
def test_a_share_has_wilsons_interval(part: int, whole: int, confidence: float) -> None:
    interval = share_interval(part, whole, confidence)
    expected = scipy.stats.binomtest(part, whole).proportion_ci(confidence, method="wilson")
    assert (interval.low, interval.high) == pytest.approx((expected.low, expected.high), abs=1e-12)
    assert (interval.value, interval.blocks) == (part / whole, whole)
    assert share_interval(0, 0, confidence) == NOTHING


@pytest.mark.parametrize("whole", [5, 10, 20, 40])
def test_the_interval_of_a_share_holds_it_in_about_95_percent(whole: int) -> None:
    """Over all true shares, with the probability of each count: the bootstrap of 0 of 5 has no width at all."""
    bounds = [share_interval(part, whole) for part in range(whole + 1)]
    low, high = (np.array([getattr(interval, end) for interval in bounds]) for end in ("low", "high"))
    shares = np.linspace(0.02, 0.98, 97)[:, None]
    held = (scipy.stats.binom.pmf(np.arange(whole + 1), whole, shares) * ((low <= shares) & (shares <= high))).sum(
        axis=1
    )
    assert 0.94 < np.mean(held) < 0.97
    assert min(held) > 0.82


def test_a_mean_of_shares_is_surer_than_each() -> None:
    """Of three equal parts each distance is divided by √3; what was not measured does not count."""
    share = share_interval(12, 20)
    mean = mean_of_intervals([share, NOTHING, share, share], 60)
    assert (mean.value, mean.blocks) == (pytest.approx(0.6), 60)
    assert mean.low == pytest.approx(0.6 - (0.6 - share.low) / np.sqrt(3.0))
    assert mean.high == pytest.approx(0.6 + (share.high - 0.6) / np.sqrt(3.0))
    assert mean_of_intervals([NOTHING], 3) == NOTHING
    assert mean_of_intervals([share_interval(5, 5), share_interval(9, 9)], 14).high == 1.0


def test_an_interval_is_read_from_a_file_as_it_was_written() -> None:
    sure, few = Interval(1.0, 0.5, 1.5, 6), Interval(1.0, 0.5, 1.5, 4)
    assert interval_of_json(sure.json()) == sure
    assert few.json() == {"value": 1.0, "low": None, "high": None, "episodes": 4}
    assert (interval_of_json(few.json()).value, interval_of_json(few.json()).bounded) == (1.0, False)
    assert NOTHING.json()["value"] is None
    assert [interval_of_json(content) for content in (NOTHING.json(), None, {})] == [NOTHING] * 3


def test_bounds_belong_together_and_are_of_five_episodes_at_least() -> None:
    both = interval_of_json({"value": 0.5, "low": 0.4, "high": 0.7})
    assert (both.value, both.low, both.high, both.blocks) == (0.5, 0.4, 0.7, 5)
    assert interval_of_json({"value": 0.5, "low": 0.4, "high": 0.7, "episodes": 9}).blocks == 9
    assert not interval_of_json({"value": 0.5, "low": 0.4, "high": 0.7, "episodes": 4}).bounded, "of an older command"
    for bounds in ({"low": None, "high": None}, {"low": 0.4, "high": None}, {"low": None, "high": 0.7}):
        single = interval_of_json({"value": 0.5, **bounds})
        assert (single.valid, single.bounded) == (True, False)


def test_an_interval_in_percent() -> None:
    assert Interval(0.5, 0.25, 0.75, 6).scaled(100.0) == Interval(50.0, 25.0, 75.0, 6)
