"""``siren train risk``: what it refuses, and what it hands to the training."""

from pathlib import Path

import pytest

from siren_ros.cli.main import main
from siren_ros.cli.train import risk
from siren_ros.errors import EXIT_BAD_INPUT, EXIT_FAILED, EXIT_OK
from siren_ros.evaluation.network_file import NetworkFile
from siren_ros.evaluation.risk.sequence_model import SequenceModel
from siren_ros.training.data_files import MadeFiles
from siren_ros.training.risk.batches import FilmFitConfig


def test_without_torch_the_command_says_what_brings_it(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    monkeypatch.setattr(risk, "_FITTER", ("siren_ros.training.not_there", "fitted"))
    assert main(["train", "risk", "--out", str(tmp_path)]) == EXIT_BAD_INPUT
    assert "./env --with models siren train risk" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(("missing", "code"), [((), EXIT_OK), (("no site",), EXIT_FAILED)])
def test_films_are_made_and_handed_on(
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
    missing: tuple[str, ...],
    code: int,
) -> None:
    def made(plan: tuple[risk.PlannedFilm, ...], folder: Path, jobs: int, _told: object) -> MadeFiles[risk.PlannedFilm]:
        assert (len(plan), folder, jobs) == (8 * (2 + 1), tmp_path / "cache", 1)
        return MadeFiles(tuple((one, folder) for one in plan), tuple((plan[0], why) for why in missing))

    def trained(_films: MadeFiles[risk.PlannedFilm], path: Path, config: FilmFitConfig, *_: object) -> SequenceModel:
        assert (path, config.epochs, config.seed) == (tmp_path / "sequence.onnx", 3, 5)
        figures = {"accuracy": 0.5, "macro_f1": 0.25, "confusion": [[1]]}
        return SequenceModel(NetworkFile(None, {"parameters": 7, "validation": figures}))

    monkeypatch.setattr(risk, "_fitter", lambda: None)
    monkeypatch.setattr(risk, "make_films", made)
    monkeypatch.setattr(risk, "train_sequence_model", trained)
    words = ["--train", "2", "--validation", "1", "--jobs", "1", "--epochs", "3", "--seed", "5"]
    assert main(["train", "risk", "--out", str(tmp_path), *words]) == code
    said = capsys.readouterr()
    assert "accuracy 50.0%, macro F1 25.0%" in said.out
    assert said.err.count("no site") == len(missing)
