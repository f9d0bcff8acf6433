"""`siren evaluate detection` as a user calls it: on a recorded episode, and with files that mean nothing."""

import csv
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest
from recorded_episode import sensed_recording

from siren_ros.cli.main import main
from siren_ros.errors import EXIT_BAD_INPUT, EXIT_OK
from siren_ros.scoring.evaluation.scores import Scores

Box = dict[str, Any]
_POSE = {"translation": [10.0, 5.0, 0.8], "size": [1.8, 4.5, 1.5], "rotation": [1.0, 0.0, 0.0, 0.0]}
_NAMES = {"detection_name": "car", "detection_score": 0.5, "attribute_name": "vehicle.moving"}
GOOD: Box = {**_POSE, "velocity": [0.0, 0.0], **_NAMES}


@pytest.fixture(scope="module", name="bag")
def _bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two seconds with LiDAR and cameras, watched by the detector that ships."""
    return sensed_recording(tmp_path_factory)


@pytest.fixture(scope="module", name="tokens")
def _tokens(bag: Path, tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    """The keyframes of the export, in order."""
    out = tmp_path_factory.mktemp("nuscenes") / "data"
    assert main(["export", "nuscenes", str(bag), "--out", str(out), "--workers", "1"]) == EXIT_OK
    return [sample["token"] for sample in json.loads((out / "v1.0-siren" / "sample.json").read_text())]


def evaluate(bag: Path, *arguments: str) -> int:
    return main(["evaluate", "detection", str(bag), *arguments, "--workers", "1"])


def rows(path: Path) -> dict[str, dict[str, str]]:
    with path.open(encoding="utf-8") as file:
        return {row["detector"]: row for row in csv.DictReader(file)}


def test_labels_score_fully_through_every_format(bag: Path, tmp_path: Path) -> None:
    assert evaluate(bag, "--self-test", "--out", str(tmp_path)) == EXIT_OK
    scores = rows(tmp_path / "by_template.csv")
    assert len(scores) == 5
    assert {row["mean"].partition("/")[0] for row in scores.values()} == {"1.000"}
    errors = rows(tmp_path / "errors.csv")
    for name, row in errors.items():
        values = [float(row[column]) for column in ("ATE m", "ASE", "AOE rad")]
        assert values == pytest.approx([0.0, 0.0, 0.0], abs=1e-3), name
        if name != "labels, topic":
            assert [float(row["AVE m/s"]), float(row["AAE"])] == pytest.approx([0.0, 0.0], abs=1e-3), name


def test_what_the_node_said_live_scores_as_the_detector_on_the_recorded_sweeps(bag: Path, tmp_path: Path) -> None:
    code = evaluate(bag, "--detections", "live=topic:/emv/detections", "--detectors", "pillars", "--out", str(tmp_path))
    assert code == EXIT_OK
    scores = json.loads((tmp_path / "scores.json").read_text(encoding="utf-8"))
    live, offline = (scores["models"][name]["curves"]["S2"] for name in ("live", "pillars"))
    assert live["labels"] > 50
    assert live["AP"] == pytest.approx(offline["AP"], abs=1e-9)
    written = Scores.of_json(scores)
    for error in ("ATE", "ASE", "AOE"):
        of_live, of_offline = (written.value(name, "template", "S2", error) for name in ("live", "pillars"))
        assert of_live == pytest.approx(of_offline, abs=1e-6)
    assert (tmp_path / "birdseye_live_S2.png").stat().st_size > 10_000
    assert (tmp_path / "curves_pillars.png").stat().st_size > 10_000


def results(path: Path, tokens: Sequence[str], boxes: dict[int, list[Box]]) -> str:
    path.write_text(json.dumps({"meta": {}, "results": {token: boxes.get(n, []) for n, token in enumerate(tokens)}}))
    return f"bad={path}"


def test_the_first_box_that_means_nothing_and_names_that_nothing_has_are_said(bag, tokens, tmp_path, siren) -> None:
    wrong = {**GOOD, "translation": [10.0, float("nan"), 0.8]}
    for given, said in (
        (results(tmp_path / "a.json", tokens, {1: [GOOD], 2: [GOOD, wrong, wrong]}), "step 20, box 1: centre"),
        (results(tmp_path / "b.json", tokens, {3: [{**GOOD, "detection_name": "tree"}]}), "names that bad gives: tree"),
    ):
        message = siren(
            ["evaluate", "detection", str(bag), "--workers", "1", "--detections", given], EXIT_BAD_INPUT
        ).err
        assert message.count("\n") == 1
        assert said in message


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ([], "--self-test"),
        (["--detections", "x"], "NAME=FILE"),
        (["--detections", "x=/nowhere.json"], "that exists"),
        (["--detectors", "yolo"], "classical, pillars"),
        (["--detectors", "pillars", "--names", "bicycle"], "names that pillars gives: "),
        (["--detectors", "classical", "--checkpoint", "pillars=/x.onnx"], "one of --detectors: classical"),
        (["--detectors", "pillars", "--detections", "pillars=/x.json"], "each name once"),
        (["--detections", "x=topic:/emv/nothing"], "/emv/detections"),
    ],
)
def test_what_cannot_be_asked_for(bag: Path, siren, given: list[str], said: str) -> None:
    assert said in siren(["evaluate", "detection", str(bag), "--workers", "1", *given], EXIT_BAD_INPUT).err
