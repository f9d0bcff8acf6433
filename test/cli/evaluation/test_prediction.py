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


def test_one_model_and_several_bags_of_a_template(bag: Path, siren) -> None:
    out = siren(["evaluate", "prediction", str(bag), str(bag), "--models", "idm", "--population=all"]).out
    assert "cv" not in out.split()
    assert "paper" not in out
    assert len([line for line in out.splitlines() if line.startswith("S2_L2_seed0")]) == 2
    (row,) = [line.split() for line in out.splitlines() if line.startswith("idm ") and "/" in line]
    assert row[-2:] == ["100", "all"]


def test_unknown_model(bag: Path, siren) -> None:
    captured = siren(["evaluate", "prediction", str(bag), "--models", "cv,lstm"], 2)
    assert captured.out == ""
    known = ", ".join(PREDICTORS)
    assert captured.err == f"siren evaluate: models: 'lstm' cannot be used; allowed: one or several of {known}\n"


def test_a_folder_of_bags_stands_for_them(bag: Path, siren) -> None:
    assert "cv" in siren(["evaluate", "prediction", str(bag.parent), "--models=cv", "--population=all"]).out.split()


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (["idm=x.pt"], "a name among the models: cv"),
        (["cv=x.pt"], "a model that has weights"),
        (["cv=x.pt", "cv=y.pt"], "each name once"),
    ],
)
def test_checkpoints_that_fit_no_model(bag, given, message, siren) -> None:
    options = [f"--checkpoint={text}" for text in given]
    assert message in siren(["evaluate", "prediction", str(bag), "--models=cv", *options], 2).err


def test_a_checkpoint_without_a_name(bag: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit, match="2"):
        main(["evaluate", "prediction", str(bag), "--checkpoint", "x.pt"])
    assert "'x.pt' is not NAME=PATH" in capsys.readouterr().err


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


def test_a_folder_that_cannot_be_written(bag: Path, siren) -> None:
    assert "out" in siren(["evaluate", "prediction", str(bag), "--out", str(bag / "metadata.yaml")], 2).err


def test_the_region_is_the_default_and_the_table_says_so(bag, tmp_path, capsys) -> None:
    assert main(["evaluate", "prediction", str(bag), "--out", str(tmp_path)]) == 0
    assert capsys.readouterr().out.startswith("population: region (vehicles within 40 m in, 50 m out around the EMV")
    scores = json.loads((tmp_path / "scores.json").read_text(encoding="utf-8"))
    assert scores["population"] == "region"
    assert 0 < scores["models"]["cv"]["samples"] < 50


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


@pytest.mark.parametrize(
    ("column", "message"), [("probability", "probabilities are not finite"), ("x", "paths are not finite")]
)
def test_predictions_with_nan_end_the_command(column, message, bag, predictions, tmp_path, siren) -> None:
    values = predictions[column].to_pylist()
    values[3] = [float("nan")] * 60 if column == "x" else float("nan")
    place = predictions.column_names.index(column)
    pq.write_table(predictions.set_column(place, column, pa.array(values)), tmp_path / "mine.parquet")
    captured = siren(["evaluate", "prediction", str(bag), f"--predictions=mine={tmp_path / 'mine.parquet'}"], 2)
    assert f"1 of 50 {message}; the first is episode S2_L2_seed0, actor" in captured.err
    assert captured.err.count("\n") == 1
    assert captured.out == ""


def test_a_file_with_the_name_of_a_model(bag: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["evaluate", "prediction", str(bag), "--predictions=cv=x.parquet"]) == 2
    assert "a name that no model has" in capsys.readouterr().err
