"""One row: how far ours is from the paper's, and whether the paper's lies within our interval."""

import pytest

from siren_ros.evaluation.paper_comparison.compared import Compared, measured
from siren_ros.evaluation.statistics.interval import NOTHING, Interval

AROUND = Interval(3.0, 1.5, 4.5, 6)


def row(paper: float, ours: Interval = AROUND, digits: int = 2, *, relative: bool = True) -> Compared:
    return Compared("ADE in m", "CV", "S1", paper, ours, digits, relative)


@pytest.mark.parametrize(
    ("paper", "inside"), [(1.5, True), (4.5, True), (1.49, False), (4.51, False), (-3.0, False), (3.0, True)]
)
def test_the_bounds_belong_to_the_interval(paper: float, *, inside: bool) -> None:
    assert row(paper).inside is inside


def test_the_deviation_is_a_share_of_the_papers() -> None:
    assert row(2.0).deviation == pytest.approx(0.5)
    assert row(4.0).deviation == pytest.approx(-0.25)
    assert row(0.0).deviation is None
    assert row(2.0, relative=False).deviation is None
    assert row(2.0, NOTHING).deviation is None


def test_cells_have_the_rows_digits() -> None:
    assert row(2.0).cells() == ("ADE in m", "CV", "S1", "2.00", "3.00 [1.50, 4.50]", "+50%", "yes")
    assert row(5.0, digits=1).cells()[3:] == ("5.0", "3.0 [1.5, 4.5]", "-40%", "no")
    alone = Interval(3.0, 3.0, 3.0, 1)
    assert row(2.0, alone).cells()[4:] == ("3.00 [-]", "+50%", "")
    assert row(2.0, NOTHING).cells()[4:] == ("-", "", "")


def test_without_bounds_or_value_json_says_nothing() -> None:
    told = row(2.0).to_json()
    assert (told["paper"], told["ours"], told["low"], told["high"], told["episodes"]) == (2.0, 3.0, 1.5, 4.5, 6)
    assert (told["deviation"], told["paper_inside"]) == (pytest.approx(0.5), True)
    single = row(2.0, Interval(3.0, 3.0, 3.0, 14, scatter_known=False)).to_json()
    assert (single["ours"], single["low"], single["high"], single["episodes"]) == (3.0, None, None, 14)
    nothing = row(2.0, NOTHING).to_json()
    assert [nothing[name] for name in ("ours", "low", "high", "deviation", "paper_inside")] == [None] * 5


def test_rows_with_a_value_of_ours() -> None:
    rows = [row(2.0), row(2.0, NOTHING), row(3.0, Interval(1.0, 1.0, 1.0, 1))]
    assert measured(rows) == [rows[0], rows[2]]
