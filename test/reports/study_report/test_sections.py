"""The sections about the tasks, how traffic made way and diversity; stored scores; the commands that a page names."""

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from shlex import split
from types import SimpleNamespace
from typing import Any

import pytest
from evaluation.diversity.made_profiles import profile
from evaluation.made_scores import reported_scores

from siren_ros.base.tables.interval import Measure
from siren_ros.base.tables.table import Table
from siren_ros.cli.generate import study_of
from siren_ros.cli.main import parser
from siren_ros.errors import InputError
from siren_ros.reports.study_report import build
from siren_ros.reports.study_report.build import (
    detection_section,
    diversity_section,
    making_way_section,
    prediction_section,
    risk_section,
)
from siren_ros.reports.study_report.page import command, generate_command
from siren_ros.reports.study_report.study import StudyMeasures, StudyRows, stored_tables
from siren_ros.running.studies.matrix import DrawPlan, Method, Study
from siren_ros.scoring.evaluation.prediction.reports.report import prediction_tables
from siren_ros.scoring.evaluation.prediction.reports.score_table import differences, score_table
from siren_ros.scoring.evaluation.yielding.metrics import EPISODE_METRICS, PEOPLE_METRICS
from siren_ros.scoring.evaluation.yielding.scoring import DriverMarks, ScoredEpisode, YieldScores

STUDY = StudyRows(Path("a study"), {}, (), "")


def test_tables_of_predictors() -> None:
    section = prediction_section(STUDY, score_table(reported_scores()))
    scores = score_table(reported_scores())
    assert section.tables == prediction_tables(scores, differences(scores))
    by_template = {table.key: table for table in section.tables}["prediction"]
    assert by_template.head == ("model", "S1", "S2", "own", "mean", "samples", "coverage")
    assert [row[:4] for row in by_template.cells()] == [
        ("cv", "2.10/6.30", "4.00/12.00", "8.00/24.00"),
        ("net:v_1", "3.33/10.00", "6.00/18.00", "16.00/48.00"),
    ]
    assert section.commands == ("./env siren evaluate prediction 'a study' --models cv,net:v_1 --out prediction",)
    assert "40 m in" in section.text[0]


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


NOTHING = {metric.name: Measure.lacking("nothing") for metric in EPISODE_METRICS}


def measures(*episodes: tuple[str, str, float], in_the_way: bool = False) -> StudyMeasures:
    """Episodes by level and map with their delays; nothing else has a value but the EMV's stops."""
    bags: list[Any] = []
    for seed, (level, map_name, delay_s) in enumerate(episodes):
        metrics = {**NOTHING, "emv_delay_s": Measure(delay_s), "emv_stops": Measure(1.0)}
        drivers = (DriverMarks(3, 0.0, in_the_way, True, False, {}),)
        scores = YieldScores(metrics, drivers)
        bags.append(SimpleNamespace(yielding=ScoredEpisode(f"b{seed}", "S2", level, seed, map_name, "", "", scores)))
    return StudyMeasures(tuple(bags), ())


@pytest.fixture
def drawn(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Names of the metrics that are drawn."""
    names: list[str] = []
    monkeypatch.setattr(build, "figure_uri", lambda _: "data:")
    monkeypatch.setattr(build, "draw_metric", lambda _, metric: names.append(metric.name))
    monkeypatch.setattr(build, "draw_drivers", lambda *_: names.append("drivers"))
    return names


@pytest.mark.parametrize("in_the_way", [True, False])
def test_metrics_of_interest_that_have_a_value_are_drawn(drawn: list[str], *, in_the_way: bool) -> None:
    section = making_way_section(STUDY, measures(("L1", "town", 3.0), in_the_way=in_the_way))
    assert drawn == ["emv_delay_s"] + ["drivers"] * in_the_way
    assert [figure.key for figure in section.figures] == ["metric_emv_delay_s"] + ["drivers"] * in_the_way


@pytest.mark.usefixtures("drawn")
def test_means_by_level_and_map() -> None:
    given = measures(*(("L2", "town", delay_s) for delay_s in (1.0, 1.5, 2.0, 2.5, 3.0)), ("L0", "town", 9.0))
    (table,) = making_way_section(STUDY, given).tables
    assert (table.key, table.head) == ("S2", ("metric", "L0", "L2", "meaning"))
    rows = {row[0]: row[1:3] for row in table.cells()}
    assert rows["emv_delay_s"] == ("9.00 [–]", "2.00 [1.02, 2.98]")
    assert rows["compliance"] == ("–", "–")
    assert len(rows) == len(EPISODE_METRICS) - len(PEOPLE_METRICS)
    one, other = making_way_section(STUDY, measures(("L2", "town", 1.0), ("L2", "Town04", 5.0))).tables
    assert [one.key, other.key] == ["S2_Town04", "S2_town"]
    assert one.caption == "Yield metrics of S2 on Town04"
    assert {row[0]: row[1] for row in one.cells()}["emv_delay_s"] == "5.00 [–]"


def test_groups_and_the_novelty_of_their_episodes(monkeypatch: pytest.MonkeyPatch) -> None:
    """At L2 three ways at 0, 3 and 10 m with two orders of events; at L3 one episode."""
    profiles = [
        profile(0, "a", "b", way=((0.0, 0.0),)),
        profile(1, "a", "b", way=((3.0, 0.0),)),
        profile(2, "a", way=((10.0, 0.0),)),
        profile(5, level="L3"),
    ]
    drawn: list[Any] = []
    monkeypatch.setattr(build, "figure_uri", lambda _: "data:")
    monkeypatch.setattr(build, "draw_coverage", lambda found, colours: drawn.append((found, colours)))
    bags: Any = tuple(SimpleNamespace(profile=one) for one in profiles)
    section = diversity_section(STUDY, StudyMeasures(bags, ()))
    groups, novelty = section.tables
    several, single = groups.cells()
    # Ways: 3, 7 and 10 m apart, the nearest 3, 3 and 7 m; orders of events: 0, 1/2 and 1/2 apart.
    assert several[:4] == ("S2", "L2", "town", "3")
    assert several[4] == "–", "the made parameters are none of S2's"
    assert several[5:9] == ("6.7", "4.3", "0.33", "0.17")
    # begin a, a b, b end, a end: the last one is of a single episode.
    assert several[9:11] == ("4", "0.3")
    assert single == ("S2", "L3", "town", "1", "–", "–", "–", "–", "–", "1", "–", "–")
    assert [row[3:] for row in novelty.cells()] == [
        ("0", "", "3.0", "0.00"),
        ("1", "", "3.0", "0.00"),
        ("2", "", "7.0", "0.50"),
        ("5", "", "–", "–"),
    ]
    ((found, colours),) = drawn
    assert [one.group[1] for one in found] == ["L2"], "its own level"
    assert len(colours) == 1


def tables(content: Mapping[str, Any]) -> Iterator[Table]:
    yield Table("one", "One", ("value",), ((str(content["value"]),),))


def test_the_tables_are_made_from_the_stored_scores(tmp_path: Path) -> None:
    assert stored_tables("risk", tmp_path, tables) is None
    (tmp_path / "scores.json").write_text(json.dumps({"value": 3}), encoding="utf-8")
    assert stored_tables("risk", tmp_path, tables) == (Table("one", "One", ("value",), (("3",),)),)


def test_scores_of_something_else_are_refused(tmp_path: Path) -> None:
    (tmp_path / "scores.json").write_text(json.dumps({"other": 3}), encoding="utf-8")
    with pytest.raises(InputError, match=r"risk.*siren evaluate risk.*value"):
        stored_tables("risk", tmp_path, tables)


STUDIES = (
    Study(("S1", "S2"), ("L0", "own"), (0, 1, 7), ("town", "../a map.xodr"), duration_s=30.0, risk_videos=3),
    Study(("S2",), draws=DrawPlan(Method.GRID, values={"emv.speed_mps": [12.5, 14.0], "demand.platoon.vehicles": [4]})),
    Study(("S2",), draws=DrawPlan(Method.RANDOM, samples=3, seed=9), preset="realistic", sensors="lidar", look="rain"),
    Study(("S2",), draws=DrawPlan(Method.LATIN_HYPERCUBE, samples=4, ranges={"emv.speed_mps": (12.0, 14.5)})),
)


@pytest.mark.parametrize("study", STUDIES)
def test_the_command_asks_for_the_same_study(study: Study) -> None:
    words = split(generate_command(study.to_json(), Path("out folder")))
    assert words[:3] == ["./env", "siren", "generate"]
    arguments = parser().parse_args(words[2:])
    assert study_of(arguments).to_json() == study.to_json()
    assert arguments.out == "out folder"


def test_paths_are_quoted() -> None:
    assert command("evaluate yield", Path("a b"), "--out x") == "./env siren evaluate yield 'a b' --out x"
