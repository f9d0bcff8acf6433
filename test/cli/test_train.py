"""``siren train`` and ``siren calibrate``: what they refuse, and what they hand on."""

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from siren_ros.base.numerics.arrays import Floats
from siren_ros.base.params.plain_files import NetworkFile
from siren_ros.cli import train
from siren_ros.data.episode_source import open_source
from siren_ros.errors import EXIT_BAD_INPUT, EXIT_FAILED, EXIT_OK
from siren_ros.lab.calibration.problem import Situation, Target
from siren_ros.lab.training.data_files import MadeFiles
from siren_ros.lab.training.prediction import samples
from siren_ros.lab.training.risk import PlannedFilm
from siren_ros.lab.training.settings import FilmFitConfig
from siren_ros.scoring.evaluation.prediction.siren_model.siren_predictor import load_network
from siren_ros.scoring.evaluation.risk.sequence_model import SequenceModel
from siren_ros.simulation.scenario.episode import EpisodeIdentity, EpisodeRequest, Split


@pytest.mark.parametrize(
    ("task", "extra"), [("prediction", "models"), ("detection", "models"), ("risk", "models"), ("driver", "rl")]
)
def test_without_torch_the_command_says_what_brings_it(monkeypatch, siren, tmp_path, task, extra) -> None:
    def missing(_: str) -> None:
        raise ModuleNotFoundError("No module named 'torch'", name="torch")

    monkeypatch.setattr(train, "import_module", missing)
    bags = [str(tmp_path)] if task == "detection" else []
    said = siren(["train", task, *bags, "--out", str(tmp_path / "new")], EXIT_BAD_INPUT).err
    assert "no torch" in said
    assert f"./env --with {extra} siren train {task}" in said
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("task", train.FITTERS)
def test_the_part_with_torch_is_found_by_its_names(task: str) -> None:
    pytest.importorskip("torch", reason="the extra models is not installed")
    if task == "driver":
        pytest.importorskip("stable_baselines3", reason="the extra rl is not installed")
    assert train.fitter_of(task).__name__ == train.FITTERS[task]


def test_a_predictor_is_trained_on_own_bags(monkeypatch, siren, tmp_path, write_bag) -> None:
    pytest.importorskip("torch", reason="the extra models is not installed")
    bag = write_bag(tmp_path / "bags" / "one", duration_s=9.0)
    with open_source(bag) as source:
        identity = EpisodeIdentity.of(source.description)
    monkeypatch.setattr(samples, "split_of", lambda _: Split.TRAIN)
    words = ["--bags", str(tmp_path / "bags"), "--epochs", "1", "--workers", "1"]
    siren(["train", "prediction", "--out", str(tmp_path / "trained"), *words], EXIT_OK)
    network = load_network(tmp_path / "trained" / "full.onnx")
    assert network.seen.trained == {identity.text, identity.content}
    assert network.card["training"]["episodes"] == 1
    monkeypatch.setattr(samples, "split_of", lambda _: Split.TEST_SEED)
    said = siren(["train", "prediction", "--out", str(tmp_path / "nothing"), *words], EXIT_BAD_INPUT).err
    assert "at least one that could be made for training" in said


@pytest.mark.parametrize(("missing", "code"), [((), EXIT_OK), (("no site",), EXIT_FAILED)])
def test_films_are_made_and_handed_on(monkeypatch, siren, tmp_path, missing, code) -> None:
    def make(samples: tuple[PlannedFilm, ...], folder: Path, jobs: int, _done: object) -> MadeFiles[PlannedFilm]:
        assert (len(samples), folder, jobs) == (8 * (2 + 1), tmp_path / "cache", 1)
        return MadeFiles(tuple((film, folder) for film in samples), tuple((samples[0], why) for why in missing))

    def train_films(_films: MadeFiles[PlannedFilm], path: Path, config: FilmFitConfig, *_: object) -> SequenceModel:
        assert (path, config.epochs, config.seed) == (tmp_path / "sequence.onnx", 3, 5)
        figures = {"accuracy": 0.5, "macro_f1": 0.25, "confusion": [[1]]}
        return SequenceModel(NetworkFile(None, {"parameters": 7, "validation": figures}))

    monkeypatch.setattr(train, "fitter_of", lambda _: None)
    monkeypatch.setattr(train, "make_films", make)
    monkeypatch.setattr(train, "train_sequence_model", train_films)
    words = ["--train", "2", "--validation", "1", "--workers", "1", "--epochs", "3", "--seed", "5"]
    said = siren(["train", "risk", "--out", str(tmp_path), *words], code)
    assert "accuracy 50.0%, macro F1 25.0%" in said.out
    assert said.err.count("no site") == len(missing)


def test_a_driver_learns_in_the_episodes_that_are_asked_for(monkeypatch, siren, tmp_path) -> None:
    asked = []

    def trained(path, config, processes, _report):
        asked.append((path, config.seed, config.episodes, config.templates, processes))
        return {"parameters": 7, "sha256": "0" * 64, "minutes": 3.2}

    monkeypatch.setattr(train, "fitter_of", lambda _: trained)
    words = ["--episodes", "4", "2", "--templates", "S3", "--seed", "5", "--workers", "1"]
    assert "7 parameters" in siren(["train", "driver", "--out", str(tmp_path), *words], EXIT_OK).out
    assert asked == [(tmp_path / "driver.onnx", 5, (4, 2), ("S3",), 1)]


NOISE_M = 0.1


@pytest.fixture
def bag(write_bag: Callable[..., Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A bag whose situation needs no simulation: the error grows with the distance of the headway from 2 s."""

    @contextmanager
    def residuals_over(targets: Sequence[Target], *_: object) -> Iterator[object]:
        assert len(targets) == 1

        def residuals(tries: Sequence[Mapping[str, float]], _: float) -> list[Floats]:
            return [np.array([values["emv_driver.approach.headway_s"] - 2.0, NOISE_M]) for values in tries]

        yield residuals

    monkeypatch.setattr(train, "residuals_over", residuals_over)
    monkeypatch.setattr(Situation, "of_record", lambda _: Situation(EpisodeRequest()))
    return write_bag(tmp_path / "bag", duration_s=2.0)


def test_what_was_found_is_printed_and_written(bag: Path, tmp_path: Path, siren) -> None:
    out = tmp_path / "found.json"
    command = ["calibrate", str(bag), "--parameters", "emv_driver.approach.headway_s", "--workers", "1"]
    lines = siren([*command, "--evaluations", "100", "--out", str(out)]).out.splitlines()
    name, value, *_ = lines[1].split()
    assert name == "emv_driver.approach.headway_s"
    assert float(value) == pytest.approx(2.0, abs=0.01)
    written = json.loads(out.read_text(encoding="utf-8"))
    assert written["values"]["emv_driver.approach.headway_s"] == pytest.approx(2.0, abs=0.01)
    assert written["targets"] == ["bag"]
    assert NOISE_M <= written["error_m"] <= written["start_error_m"]
    assert written["undetermined"] == []
    assert written["agreed"] is True
    assert len(lines) == 3, "nothing to warn of"


def test_what_the_trajectories_do_not_determine_is_said(bag, tmp_path, siren) -> None:
    names = "emv_driver.approach.headway_s,emv_driver.driving.comfort_accel_mps2"
    command = ["calibrate", str(bag), "--parameters", names, "--evaluations", "30", "--workers", "1"]
    *_, named, spent = siren([*command, "--out", str(tmp_path / "found.json")]).out.splitlines()
    assert named.startswith("not determined by these trajectories: emv_driver.driving.comfort_accel_mps2 ")
    assert "more --evaluations" in spent
    assert json.loads((tmp_path / "found.json").read_text())["undetermined"] == [
        "emv_driver.driving.comfort_accel_mps2"
    ]


def test_bad_options_are_refused(bag: Path, write_bag: Callable[..., Path], tmp_path: Path, siren) -> None:
    for option in (
        "--parameters=mood",
        "--parameters=",
        "--parameters=sumo.tau_s",
        "--workers=0",
        "--evaluations=2",
        "--trajectory=no",
    ):
        assert siren(["calibrate", str(bag), option], 2).err.count("\n") == 1
    write_bag(tmp_path / "other", duration_s=1.0)
    assert "one bag" in siren(["calibrate", str(tmp_path), "--trajectory", str(bag / "x.csv")], 2).err
