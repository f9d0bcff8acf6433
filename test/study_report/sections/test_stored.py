"""Sections of scores that commands have written."""

import json
from pathlib import Path
from typing import Any

from siren_ros.study_report.sections.detection import detection_section
from siren_ros.study_report.sections.risk import risk_section
from siren_ros.study_report.study_rows import StudyRows

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
