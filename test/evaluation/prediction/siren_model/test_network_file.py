import hashlib
import json

import pytest
from made_records import moving
from scenes import batch_of

from siren_ros.errors import InputError
from siren_ros.evaluation.network_file import card_path
from siren_ros.evaluation.prediction.siren_model.features import features_of
from siren_ros.evaluation.prediction.siren_model.network_file import load_network
from siren_ros.evaluation.prediction.siren_model.siren_predictor import SHIPPED
from siren_ros.params.resources import params_dir
from siren_ros.roads.road_network import RoadNetwork


@pytest.fixture
def copied(tmp_path):
    """The weights that ship, in a folder of their own."""
    shipped, path = params_dir() / SHIPPED, tmp_path / "mine.onnx"
    path.write_bytes(shipped.read_bytes())
    card_path(path).write_text(card_path(shipped).read_text())
    return path


def changed_card(path, **changes):
    card = json.loads(card_path(path).read_text())
    card_path(path).write_text(json.dumps({**card, **changes}))


def test_weights_and_card_belong_together(copied) -> None:
    load_network(copied)
    copied.write_bytes(copied.read_bytes() + b" ")
    with pytest.raises(InputError, match="another hash"):
        load_network(copied)


def test_another_version_of_the_features_is_refused(copied) -> None:
    changed_card(copied, features_version=999)
    with pytest.raises(InputError, match="not 999"):
        load_network(copied)


@pytest.mark.parametrize("content", ["", "[]", "{}", "no json"])
def test_a_card_that_is_none_is_refused(copied, content) -> None:
    card_path(copied).write_text(content)
    with pytest.raises(InputError, match="checkpoint"):
        load_network(copied)


def test_a_file_that_is_missing_is_refused(tmp_path) -> None:
    with pytest.raises(InputError, match="ONNX file"):
        load_network(tmp_path / "none.onnx")


def test_a_file_that_is_no_network_is_refused(copied) -> None:
    content = b"not a network"
    copied.write_bytes(content)
    changed_card(copied, sha256=hashlib.sha256(content).hexdigest())
    with pytest.raises(InputError, match="checkpoint"):
        load_network(copied)


def test_of_no_sample_there_is_no_answer_of_one_path(copied) -> None:
    network = load_network(copied)
    none = features_of(batch_of({1: moving(0.0, 0.0, 5.0, steps=100)}, RoadNetwork((), (), (), {}, (0.0, 0.0), "!")))
    assert len(none) == 0
    xy_m, probability = network.run(none)
    assert (xy_m.shape, probability.shape) == ((0, 1, 25, 2), (0, 1))
