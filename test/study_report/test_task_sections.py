"""The sections about the tasks."""

import json
from pathlib import Path
from typing import Any

from evaluation.made_scores import reported_scores

from siren_ros.evaluation.paper_comparison import Compared
from siren_ros.evaluation.prediction.reports.score_table import score_table
from siren_ros.evaluation.statistics.interval import Interval
from siren_ros.study_report.study import StudyRows
from siren_ros.study_report.task_sections import _paper_tables, detection_section, prediction_section, risk_section


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


STUDY = StudyRows(Path("a study"), {}, (), "")


def template(mean_ap: float, labels: int = 10) -> dict[str, Any]:
    interval = {"value": mean_ap, "low": mean_ap - 0.05, "high": mean_ap + 0.05, "episodes": 6}
    return {"mAP": interval, "NDS": mean_ap / 2.0, "labels": labels, "errors": {"ATE": 0.5, "AOE": 0.25}}


def detector(parts: list[dict[str, Any]], **templates: float) -> dict[str, Any]:
    mean = {"mAP": template(0.4)["mAP"], "NDS": 0.2}
    return {"mean": mean, "templates": {name: template(value) for name, value in templates.items()}, "parts": parts}


def written(folder: Path, content: Any) -> Path:
    folder.mkdir(exist_ok=True)
    (folder / "scores.json").write_text(json.dumps(content), encoding="utf-8")
    return folder


def test_detectors_with_different_templates(tmp_path: Path) -> None:
    parts = [
        {"of": "distance", "name": "0-15 m", "labels": 1234, "mAP": template(0.5)["mAP"]},
        {"of": "distance", "name": "15-30 m", "labels": 0, "mAP": None},
    ]
    folder = written(tmp_path / "d", {"one": detector(parts, S1=0.4), "other": detector([], S2=0.6)})
    section = detection_section(STUDY, folder)
    assert section is not None
    by_template, errors, of_parts = section.tables
    assert by_template.head == ("detector", "S1", "S2", "mean")
    assert by_template.rows == (
        ("one", "0.400 / 0.200", "–", "0.400 [0.350, 0.450] / 0.200"),
        ("other", "–", "0.600 / 0.300", "0.400 [0.350, 0.450] / 0.200"),
    )
    assert errors.rows[0] == ("one", "S1", "0.500", "–", "0.250", "–", "–")
    assert of_parts.rows == (("one", "distance", "0-15 m", "1,234", "0.500 [0.450, 0.550]"),)
    assert section.commands[0].startswith("./env siren evaluate detection 'a study' ")
    bare = detection_section(STUDY, written(tmp_path / "e", {"one": detector([], S1=0.4)}))
    assert bare is not None
    assert [table.key for table in bare.tables] == ["detection_templates", "detection_errors"]


def test_models_that_judge_risk(tmp_path: Path) -> None:
    score = {"value": 0.5, "low": 0.25, "high": 0.75, "episodes": 6}
    model = {
        "videos": 5, "answered": 4, "scores": {"accuracy": score, "f1_collision": {"value": None}},
        "confusion": [[2, 0, 0, 0], [1, 0, 0, 0], [0, 0, 0, 1]],
    }  # fmt: skip
    content = {"classes": ["Normal", "Near-Miss", "Collision"], "models": {"m": model}}
    section = risk_section(written(tmp_path, content))
    assert section is not None
    models, confusion = section.tables
    assert models.rows == (("m", "4 of 5", "50.0 [25.0, 75.0]", "–", "–", "–", "–", "–"),)
    assert confusion.head == (
        "model", "label", "answered Normal", "answered Near-Miss", "answered Collision", "unreadable"
    )  # fmt: skip
    assert confusion.rows[1] == ("m", "Near-Miss", "1", "0", "0", "0")
    assert risk_section(tmp_path / "nowhere") is None


def test_the_papers_rows_and_ours() -> None:
    rows = [
        Compared("ADE in m", "CV", "S1", 1.63, Interval(1.5, 1.4, 1.7, 5)),
        Compared("ADE in m", "CV", "mean", 1.44, Interval(2.0, 1.9, 2.1, 5)),
        Compared("ADE in m", "IDM", "S1", 2.23, Interval(2.23, 2.23, 2.23, 1)),
        Compared("mAP", "SECOND", "S3", 0.631, Interval(0.6, 0.5, 0.7, 6), digits=3),
        Compared("error ATE", "SECOND", "mean", 0.565, digits=3),
    ]
    first, second, third = _paper_tables(rows)
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
