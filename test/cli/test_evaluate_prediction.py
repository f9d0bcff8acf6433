import json
from collections.abc import Callable
from pathlib import Path

import pytest

from siren_ros.cli.main import main
from siren_ros.evaluation.prediction.predictors import PREDICTORS


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory, write_bag: Callable[..., Path]) -> Path:
    return write_bag(tmp_path_factory.mktemp("bags") / "S2_L2_seed0", duration_s=9.0)


@pytest.fixture(scope="module")
def short_bag(tmp_path_factory: pytest.TempPathFactory, write_bag: Callable[..., Path]) -> Path:
    return write_bag(tmp_path_factory.mktemp("bags") / "short", duration_s=1.0)


def test_prediction_prints_values_beside_the_papers(
    bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out_file = tmp_path / "new" / "scores.json"
    assert main(["evaluate", "prediction", str(bag), "--population", "all", "--out", str(out_file.parent)]) == 0
    out = capsys.readouterr().out
    scores = json.loads(out_file.read_text(encoding="utf-8"))
    cv = scores["episodes"][0]["models"]["cv"]
    assert out.startswith("population: all vehicles on the map\n")
    assert scores["episodes"][0]["population"] == "all"
    (row,) = [line.split() for line in out.splitlines() if line.startswith("S2_L2_seed0")]
    assert row[:4] == ["S2_L2_seed0", "S2", "L2", "50"]
    assert row[4:6] == [f"{cv['ade_m']:.2f}/{cv['fde_m']:.2f}", "1.17/3.11"]
    assert row[7] == "1.58/3.75"
    assert "mean of 1 template " in out
    assert "the paper's 1.44 m" in out
    assert "needs 3 templates" in out


def test_one_model_and_several_bags_of_a_template(bag: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["evaluate", "prediction", str(bag), str(bag), "--models", "idm", "--population=all"]) == 0
    out = capsys.readouterr().out
    assert "cv" not in out.split()
    (row,) = [line.split() for line in out.splitlines() if line.startswith("mean of 2 bags")]
    assert row[4:6] == ["S2", "100"]


def test_unknown_model(bag: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["evaluate", "prediction", str(bag), "--models", "cv,lstm"]) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    known = ", ".join(PREDICTORS)
    assert captured.err == f"siren evaluate: models: 'lstm' cannot be used; allowed: one or several of {known}\n"


def test_a_folder_of_bags_stands_for_them(bag: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["evaluate", "prediction", str(bag.parent), "--models=cv", "--population=all"]) == 0
    assert [line for line in capsys.readouterr().out.splitlines() if line.startswith("S2_L2_seed0")]


@pytest.mark.parametrize(
    ("given", "told"),
    [
        (["idm=x.pt"], "a name among the models: cv"),
        (["cv=x.pt"], "a model that has weights"),
        (["cv=x.pt", "cv=y.pt"], "each name once"),
    ],
)
def test_checkpoints_that_fit_no_model(
    bag: Path, given: list[str], told: str, capsys: pytest.CaptureFixture[str]
) -> None:
    options = [f"--checkpoint={one}" for one in given]
    assert main(["evaluate", "prediction", str(bag), "--models=cv", *options]) == 2
    assert told in capsys.readouterr().err


def test_a_checkpoint_without_a_name(bag: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit, match="2"):
        main(["evaluate", "prediction", str(bag), "--checkpoint", "x.pt"])
    assert "'x.pt' is not NAME=PATH" in capsys.readouterr().err


def test_unreadable_bag_does_not_keep_the_others(bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["evaluate", "prediction", str(tmp_path / "none"), str(bag)]) == 2
    captured = capsys.readouterr()
    assert captured.err.count("\n") == 1
    assert "none" in captured.err
    assert "S2_L2_seed0" in captured.out


def test_bag_without_a_whole_window(short_bag: Path, bag: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["evaluate", "prediction", str(short_bag), str(bag)]) == 1
    captured = capsys.readouterr()
    assert "short: no vehicle was in the region around the EMV for a whole window" in captured.err
    (row,) = [line.split() for line in captured.out.splitlines() if line.startswith("short")]
    assert row[3:5] == ["0", "-/-"]


def test_a_folder_that_cannot_be_written(bag: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["evaluate", "prediction", str(bag), "--out", str(bag / "metadata.yaml")]) == 2
    assert "out" in capsys.readouterr().err


def test_the_region_is_the_default_and_the_table_says_so(
    bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out_file = tmp_path / "scores.json"
    assert main(["evaluate", "prediction", str(bag), "--out", str(out_file.parent)]) == 0
    assert capsys.readouterr().out.startswith("population: region (vehicles within 40 m in, 50 m out around the EMV")
    episode = json.loads(out_file.read_text(encoding="utf-8"))["episodes"][0]
    assert episode["population"] == "region"
    assert 0 < episode["models"]["cv"]["samples"] < 50
