"""Numbers, pairs and bounds as text."""

from siren_ros.evaluation.prediction.reports.text_table import bounds, number, pair
from siren_ros.evaluation.statistics.interval import NOTHING, Interval


def test_numbers_have_two_digits_and_nothing_is_a_dash() -> None:
    assert [number(value) for value in (0.0, 1.005, -2.0, None)] == ["0.00", "1.00", "-2.00", "-"]
    assert number(1.26, 1) == "1.3"
    assert pair([1.444, None]) == "1.44/-"
    assert pair([2.0]) == "2.00"


def test_bounds_need_several_episodes() -> None:
    assert bounds(Interval(1.4, 1.196, 1.664, 5)) == "[1.20, 1.66]"
    assert bounds(NOTHING) == "-"
    assert bounds(Interval(1.4, 1.2, 1.6, 4)) == "[-]", "of four episodes"
    assert bounds(Interval(1.4, 1.2, 1.6, 9, scatter_known=False)) == "[-]"
