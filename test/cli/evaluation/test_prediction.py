import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from siren_ros.cli.main import main
from siren_ros.data.recording.bag_reader import read_episode
from siren_ros.scoring.evaluation.prediction.predictors import PREDICTORS
from siren_ros.scoring.evaluation.prediction.samples import HistoryWindow, Population, samples_of

KNOWN = ", ".join(PREDICTORS)


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory, write_bag: Callable[..., Path]) -> Path:
    return write_bag(tmp_path_factory.mktemp("bags") / "S2_L2_seed0", duration_s=9.0)


@pytest.fixture(scope="module")
def short_bag(tmp_path_factory: pytest.TempPathFactory, write_bag: Callable[..., Path]) -> Path:
    return write_bag(tmp_path_factory.mktemp("bags") / "short", duration_s=1.0)


def test_prediction_prints_tables_and_writes_files(bag, tmp_path, siren) -> None:
    out = tmp_path / "new" / "scores"
    words = ["evaluate", "prediction", str(bag), "--population", "all", "--compare-paper", "--out", str(out)]
    printed = siren(words).out
    assert printed == (out / "report.txt").read_text(encoding="utf-8")
    assert printed.startswith("population: all vehicles on the map\n")
    scores = json.loads((out / "scores.json").read_text(encoding="utf-8"))
    assert scores["population"] == "all"
    cv = scores["episodes"][0]["models"]["cv"]
    row = next(line.split() for line in printed.splitlines() if line.startswith("cv "))
    assert row[:4] == ["cv", "–/–", f"{cv['ade_m']:.2f}/{cv['fde_m']:.2f}", "–/–"]
    assert row[-2:] == ["50", "all"]
    assert "the paper's 1.44 m" in printed
    assert "needs 3 templates" in printed
    assert sum("(paper)" in line for line in printed.splitlines()) == 9
    assert (out / "prediction.tex").is_file()


def test_a_folder_of_bags_stands_for_them_and_the_region_is_the_default(bag, tmp_path, siren) -> None:
    printed = siren(["evaluate", "prediction", str(bag.parent), "--models=idm", "--out", str(tmp_path)]).out
    assert printed.startswith("population: region (vehicles within 40 m in, 50 m out around the EMV")
    scores = json.loads((tmp_path / "scores.json").read_text(encoding="utf-8"))
    assert scores["population"] == "region"
    assert 0 < scores["models"]["idm"]["samples"] < 50
    assert "cv" not in scores["models"]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--models=cv,lstm"], f"siren evaluate: models: 'lstm' cannot be used; allowed: one or several of {KNOWN}\n"),
        (["--checkpoint=idm=x.pt"], "a name among the models: cv"),
        (["--checkpoint=cv=x.pt"], "a model that has weights"),
        (["--checkpoint=cv=x.pt", "--checkpoint=cv=y.pt"], "each name once"),
        (["--predictions=cv=x.parquet"], "a name that no model has"),
        (["--out=/dev/null/scores"], "out: "),
    ],
)
def test_what_cannot_be_asked_for(bag, options, message, siren) -> None:
    assert message in siren(["evaluate", "prediction", str(bag), "--models=cv", *options], 2).err


def test_unreadable_bag_does_not_keep_the_others(bag: Path, tmp_path: Path, siren) -> None:
    captured = siren(["evaluate", "prediction", str(tmp_path / "none"), str(bag)], 2)
    assert captured.err.count("\n") == 1
    assert "none" in captured.err
    assert "idm - " in captured.out or "cv - idm" in captured.out


def test_bag_without_a_whole_window(short_bag: Path, bag: Path, siren) -> None:
    captured = siren(["evaluate", "prediction", str(short_bag), str(bag)], 1)
    assert "short: no vehicle was in the region around the EMV for a whole window" in captured.err
    (row,) = [line.split() for line in captured.out.splitlines() if line.startswith("short")]
    assert row[3:] == ["0", "–/–", "–/–", "–/–"]


@pytest.fixture(scope="module")
def predictions(bag: Path) -> pa.Table:
    """Constant velocity, as another program would hand it in: by the folder's name, from 6 s at 0.1 s."""
    samples = samples_of(read_episode(bag), HistoryWindow(), Population.ALL)
    batch = samples.batch
    times = 0.1 * np.arange(1, 61)
    path = batch.xy_m[:, None] + times[:, None] * batch.velocity_mps[:, None]
    actor, step = batch.actors.actor_id[batch.target].astype(np.int64), batch.step[batch.actors.frame[batch.target]]
    columns = {"episode": [bag.name] * len(batch), "actor": actor, "step": step}
    columns |= {"mode": np.zeros(len(batch), dtype=np.int64), "probability": np.ones(len(batch))}
    return pa.table({**columns, "x": list(path[..., 0]), "y": list(path[..., 1])})


def test_predictions_of_a_file_are_scored_like_a_model(bag, predictions, tmp_path, siren, capsys) -> None:
    pq.write_table(predictions, tmp_path / "mine.parquet")
    words = ["evaluate", "prediction", str(bag), f"--predictions=mine={tmp_path / 'mine.parquet'}", "--population=all"]
    assert main([*words, "--models=cv", "--out", str(tmp_path / "out")]) == 0
    models = json.loads((tmp_path / "out" / "scores.json").read_text(encoding="utf-8"))["episodes"][0]["models"]
    assert models["mine"]["ade_m"] == pytest.approx(models["cv"]["ade_m"], abs=1e-12)
    capsys.readouterr()
    assert "cv" not in siren([*words, "--models=none"]).out.split()


def test_missing_predictions_are_refused_or_shown_as_coverage(bag, predictions, tmp_path, siren) -> None:
    pq.write_table(predictions.slice(5), tmp_path / "mine.parquet")
    words = ["evaluate", "prediction", str(bag), f"--predictions=mine={tmp_path / 'mine.parquet'}", "--population=all"]
    assert "5 of 50 samples have no prediction; the first is actor" in siren(words, 2).err
    lines = siren([*words, "--allow-missing"]).out.splitlines()
    assert ["45", "90.0%"] in [line.split()[-2:] for line in lines if line.startswith("mine ")]
