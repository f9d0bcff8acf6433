"""Two rows for each of the paper's, and a star where its value lies in ours."""

from siren_ros.evaluation.paper_comparison.compared import Compared
from siren_ros.evaluation.statistics.interval import Interval
from siren_ros.study_report.sections.paper import _tables


def test_the_papers_rows_and_ours() -> None:
    rows = [
        Compared("ADE in m", "CV", "S1", 1.63, Interval(1.5, 1.4, 1.7, 5)),
        Compared("ADE in m", "CV", "mean", 1.44, Interval(2.0, 1.9, 2.1, 5)),
        Compared("ADE in m", "IDM", "S1", 2.23, Interval(2.23, 2.23, 2.23, 1)),
        Compared("mAP", "SECOND", "S3", 0.631, Interval(0.6, 0.5, 0.7, 6), digits=3),
        Compared("error ATE", "SECOND", "mean", 0.565, digits=3),
    ]
    first, second, third = _tables(rows)
    assert (third.caption, third.rows[1]) == ("Error ATE", ("SECOND, here", "–"))
    assert (first.key, first.caption, first.head) == ("paper_0", "ADE in m", ("", "S1", "mean"))
    assert first.rows == (
        ("CV, paper", "1.63", "1.44"),
        ("CV, here", "1.50 [1.40, 1.70] *", "2.00 [1.90, 2.10]"),
        ("IDM, paper", "2.23", "–"),
        ("IDM, here", "2.23 [–]", "–"),
    )
    assert (second.key, second.caption, second.head) == ("paper_1", "mAP", ("", "S3"))
    assert second.rows[0] == ("SECOND, paper", "0.631")
    assert second.rows[1] == ("SECOND, here", "0.600 [0.500, 0.700] *")
