import pytest

from siren_ros.cli.main import main
from siren_ros.cli.train import detection
from siren_ros.errors import EXIT_BAD_INPUT


@pytest.mark.parametrize(
    ("given", "named"),
    [(["--steps", "0"], "steps"), (["--threads", "0"], "threads"), (["--out", "detector.bin"], "out")],
)
def test_what_trains_nothing_is_refused(monkeypatch, capsys, tmp_path, given, named) -> None:
    monkeypatch.setattr(detection, "_fitter", lambda: None)
    assert main(["train", "detection", str(tmp_path), "--out", "detector.onnx", *given]) == EXIT_BAD_INPUT
    assert named in capsys.readouterr().err


def test_without_torch_the_command_says_what_brings_it(monkeypatch, capsys, tmp_path) -> None:
    monkeypatch.setattr(detection, "_FITTER", ("siren_ros.training.not_there", "fitted_detector"))
    assert main(["train", "detection", str(tmp_path), "--out", str(tmp_path / "a.onnx")]) == EXIT_BAD_INPUT
    assert "./env --with models siren train detection" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []
