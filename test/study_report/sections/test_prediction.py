"""Tables of made scores; ``reported_scores`` says what their numbers follow from."""

from pathlib import Path

from evaluation.made_scores import reported_scores

from siren_ros.evaluation.prediction.reports.score_table import score_table
from siren_ros.study_report.sections.prediction import prediction_section
from siren_ros.study_report.study_rows import StudyRows


def test_tables() -> None:
    section = prediction_section(StudyRows(Path("s"), {}, (), ""), score_table(reported_scores()))
    by_template, metrics, by_level, by_category = section.tables
    assert by_template.head == ("model", "S1", "S2", "own", "mean", "ADE with interval", "samples")
    assert by_template.rows == (
        ("cv", "2.10/6.30", "4.00/12.00", "8.00/24.00", "4.70/14.10", "4.70 [–]", "10"),
        ("net:v_1", "3.33/10.00", "6.00/18.00", "16.00/48.00", "8.44/25.33", "8.44 [–]", "6"),
    )
    assert metrics.rows[0] == ("cv", "4.70", "14.10", "2.35", "7.05", "19.45", "0.87", "–", "–", "–")
    assert by_level.head == ("level", "cv", "net:v_1")
    assert by_level.rows == (("L2", "6.00 [–]", "11.00 [–]"), ("L3", "2.10 [–]", "3.33 [–]"))
    assert [row[0] for row in by_category.rows] == ["emv", "yielding", "held", "other"]
    assert by_category.rows[2] == ("held", "–", "–")
    assert section.commands == ("./env siren evaluate prediction s --models cv,net:v_1 --out prediction",)
    assert "40 m in" in section.text[0]
