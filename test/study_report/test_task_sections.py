"""The sections about the tasks."""

import json
from pathlib import Path
from typing import Any

from evaluation.made_scores import reported_scores

from siren_ros.evaluation.prediction.reports.score_table import differences, score_table
from siren_ros.evaluation.prediction.reports.tables import prediction_tables
from siren_ros.study_report.study import StudyRows
from siren_ros.study_report.task_sections import detection_section, prediction_section, risk_section


def test_tables() -> None:
    section = prediction_section(StudyRows(Path("s"), {}, (), ""), score_table(reported_scores()))
    scores = score_table(reported_scores())
    assert section.tables == prediction_tables(scores, differences(scores))
    by_template = {table.key: table for table in section.tables}["prediction"]
    assert by_template.head == ("model", "S1", "S2", "own", "mean", "samples", "coverage")
    assert [row[:4] for row in by_template.cells()] == [
        ("cv", "2.10/6.30", "4.00/12.00", "8.00/24.00"),
        ("net:v_1", "3.33/10.00", "6.00/18.00", "16.00/48.00"),
    ]
    assert section.commands == ("./env siren evaluate prediction s --models cv,net:v_1 --out prediction",)
    assert "40 m in" in section.text[0]


STUDY = StudyRows(Path("a study"), {}, (), "")


def template(mean_ap: float, labels: int = 10) -> dict[str, Any]:
    interval = {"value": mean_ap, "low": mean_ap - 0.05, "high": mean_ap + 0.05, "episodes": 6}
    return {"mAP": interval, "NDS": mean_ap / 2.0, "labels": labels, "errors": {"ATE": 0.5, "AOE": 0.25}}


def detector(parts: list[dict[str, Any]], **templates: float) -> dict[str, Any]:
    return {
        "mean": {"mAP": template(0.4)["mAP"], "NDS": 0.2},
        "templates": {name: template(value) for name, value in templates.items()},
        "families": {},
        "parts": parts,
    }


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
    by_template, errors, by_both, of_parts = section.tables
    assert by_template.head == ("detector", "S1", "S2", "mean")
    assert by_template.cells() == [
        ("one", "0.400/0.200", "–", "0.400/0.200"),
        ("other", "–", "0.600/0.300", "0.400/0.200"),
        ("one, 95 % of mAP", "[0.350, 0.450]", "–", "[0.350, 0.450]"),
        ("other, 95 % of mAP", "–", "[0.550, 0.650]", "[0.350, 0.450]"),
    ]
    assert errors.cells()[0] == ("one", "0.500", "–", "0.250", "–", "–")
    assert by_both.cells()[0] == ("one", "S1", "0.500", "–", "0.250", "–", "–")
    assert of_parts.cells() == [("distance", "0-15 m", "1,234", "0.500 [0.450, 0.550]", "–")]
    assert section.commands[0].startswith("./env siren evaluate detection 'a study' ")
    bare = detection_section(STUDY, written(tmp_path / "e", {"one": detector([], S1=0.4)}))
    assert bare is not None
    assert [table.key for table in bare.tables] == ["by_template", "errors", "errors_by_template"]


def test_models_that_judge_risk(tmp_path: Path) -> None:
    score = {"value": 0.5, "low": 0.25, "high": 0.75, "episodes": 6}
    model = {
        "videos": 5, "answered": 4, "scores": {"accuracy": score, "f1_collision": {"value": None}},
        "confusion": [[2, 0, 0, 0], [1, 0, 0, 0], [0, 0, 0, 1]], "confusion_by_template": {},
    }  # fmt: skip
    content = {"classes": ["Normal", "Near-Miss", "Collision"], "models": {"m": model}}
    section = risk_section(written(tmp_path, content))
    assert section is not None
    models, classes, confusion = section.tables
    assert models.cells() == [("m", "4/5", "50.00 [25.00, 75.00]", "–", "–")]
    assert classes.cells() == [("m", *["–"] * 9)]
    assert confusion.head == (
        "model", "label", "answered Normal", "answered Near-Miss", "answered Collision", "unreadable"
    )  # fmt: skip
    assert confusion.cells()[1] == ("m", "Near-Miss", "1", "0", "0", "0")
    assert risk_section(tmp_path / "nowhere") is None
