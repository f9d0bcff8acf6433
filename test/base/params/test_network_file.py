"""A network and its card as files."""

import hashlib
import json
from pathlib import Path

import pytest

from siren_ros.base.params.network_file import card_path, open_network, write_network
from siren_ros.base.params.resources import params_dir
from siren_ros.errors import InputError
from siren_ros.scoring.evaluation.prediction.siren_model.siren_predictor import SHIPPED


def test_what_is_written_can_be_opened_and_written_again(tmp_path) -> None:
    weights = (params_dir() / SHIPPED).read_bytes()
    card = {"name": "mine", "sha256": hashlib.sha256(weights).hexdigest()}
    path = tmp_path / "deep" / "mine.onnx"
    for name in ("mine", "other"):
        write_network(path, weights, {**card, "name": name})
        network = open_network(path)
        assert network.card == {**card, "name": name}
        assert {output.name for output in network.session.get_outputs()} == {"xy_m", "probability"}
    text = card_path(path).read_text(encoding="utf-8")
    assert json.loads(text)["name"] == "other"
    assert text.endswith("\n}\n")


def test_a_card_stands_next_to_its_network() -> None:
    assert card_path(Path("a/b.c.onnx")) == Path("a/b.c.json")


def test_a_folder_that_cannot_be_written(tmp_path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(InputError, match="file"):
        write_network(tmp_path / "file" / "a.onnx", b"", {})
