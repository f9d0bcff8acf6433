"""How numbers are written."""

from siren_ros.evaluation.statistics.interval import NOTHING, Interval
from siren_ros.study_report.cells import count_of, number, pair, share_of, with_interval


def test_numbers_and_what_is_none() -> None:
    assert [number(value) for value in (0.0, 1.239, -2.0, None)] == ["0.00", "1.24", "-2.00", "–"]
    assert number(1.26, 1) == "1.3"
    assert pair([1.444, None]) == "1.44/–"


def test_an_interval_is_written_where_it_is_bounded() -> None:
    found = Interval(2.284, 2.104, 2.426, 5)
    assert with_interval(found) == "2.28 [2.10, 2.43]"
    assert with_interval(found, 1, "+") == "+2.3 [+2.1, +2.4]"
    assert with_interval(Interval(-2.0, -3.0, 1.0, 5), sign="+") == "-2.00 [-3.00, +1.00]"
    assert with_interval(Interval(2.0, 2.0, 2.0, 1)) == "2.00 [–]"
    assert with_interval(NOTHING) == "–"


def test_a_share_has_wilsons_interval() -> None:
    assert share_of(17, 20) == "17 of 20 [64, 95] %"
    assert share_of(0, 5) == "0 of 5 [0, 43] %"
    assert share_of(3, 4) == "3 of 4 [–]"
    assert share_of(0, 0) == "–"


def test_one_and_several() -> None:
    assert [count_of(count, "bag") for count in (0, 1, 2, 1234)] == ["0 bags", "1 bag", "2 bags", "1,234 bags"]
