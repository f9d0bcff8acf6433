import pytest

from siren_ros.cli.main import main
from siren_ros.cli.train import prediction
from siren_ros.errors import EXIT_BAD_INPUT


@pytest.mark.parametrize("given", [["--train-seeds", "0"], ["--jobs", "0"], ["--epochs", "0"]])
def test_numbers_that_train_nothing_are_refused(monkeypatch, capsys, tmp_path, given) -> None:
    monkeypatch.setattr(prediction, "_fitter", lambda: None)
    assert main(["train", "prediction", "--out", str(tmp_path), *given]) == EXIT_BAD_INPUT
    assert given[0][2:].replace("-", "_") in capsys.readouterr().err


def test_without_torch_the_command_says_what_brings_it(monkeypatch, capsys, tmp_path) -> None:
    monkeypatch.setattr(prediction, "_FITTER", ("siren_ros.training.not_there", "fitted_network"))
    assert main(["train", "prediction", "--out", str(tmp_path)]) == EXIT_BAD_INPUT
    assert "./env --with models siren train prediction" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []
