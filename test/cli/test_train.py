"""``siren train``: what it refuses, and what it hands to the trainings."""

from pathlib import Path

import pytest

from siren_ros.base.params.network_file import NetworkFile
from siren_ros.cli import train
from siren_ros.data.record.episode_source import open_source
from siren_ros.errors import EXIT_BAD_INPUT, EXIT_FAILED, EXIT_OK
from siren_ros.lab.training.data_files import MadeFiles
from siren_ros.lab.training.prediction import plan
from siren_ros.lab.training.risk.samples import PlannedFilm
from siren_ros.lab.training.settings import FilmFitConfig
from siren_ros.scoring.evaluation.prediction.siren_model.siren_predictor import load_network
from siren_ros.scoring.evaluation.risk.sequence_model import SequenceModel
from siren_ros.simulation.scenario.splits import EpisodeIdentity, Split


@pytest.mark.parametrize(
    ("task", "words", "option"),
    [
        ("detection", ["--steps", "0"], "steps"),
        ("detection", ["--threads", "0"], "threads"),
        ("detection", ["--out", "detector.bin"], "out"),
        ("prediction", ["--train-seeds", "0"], "train_seeds"),
        ("prediction", ["--workers", "0"], "workers"),
        ("prediction", ["--epochs", "0"], "epochs"),
        ("driver", ["--workers", "0"], "workers"),
    ],
)
def test_what_trains_nothing_is_refused(monkeypatch, siren, tmp_path, task, words, option) -> None:
    monkeypatch.setattr(train, "fitter_of", lambda _: None)
    bags = [str(tmp_path)] if task == "detection" else []
    assert option in siren(["train", task, *bags, "--out", str(tmp_path / "detector.onnx"), *words], EXIT_BAD_INPUT).err


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
    monkeypatch.setattr(plan, "split_of", lambda _: Split.TRAIN)
    words = ["--bags", str(tmp_path / "bags"), "--epochs", "1", "--workers", "1"]
    siren(["train", "prediction", "--out", str(tmp_path / "trained"), *words], EXIT_OK)
    network = load_network(tmp_path / "trained" / "full.onnx")
    assert network.seen.trained == {identity.text}
    assert network.card["training"]["episodes"] == 1
    monkeypatch.setattr(plan, "split_of", lambda _: Split.TEST_SEED)
    said = siren(["train", "prediction", "--out", str(tmp_path / "nothing"), *words], EXIT_BAD_INPUT).err
    assert "at least one that could be made for training" in said


@pytest.mark.parametrize(("missing", "code"), [((), EXIT_OK), (("no site",), EXIT_FAILED)])
def test_films_are_made_and_handed_on(monkeypatch, siren, tmp_path, missing, code) -> None:
    def make(plan: tuple[PlannedFilm, ...], folder: Path, jobs: int, _done: object) -> MadeFiles[PlannedFilm]:
        assert (len(plan), folder, jobs) == (8 * (2 + 1), tmp_path / "cache", 1)
        return MadeFiles(tuple((film, folder) for film in plan), tuple((plan[0], why) for why in missing))

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
