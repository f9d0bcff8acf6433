import hashlib
import json
from dataclasses import replace

import numpy as np
import pytest
from made_records import moving
from scenes import batch_of, moved, showing, with_signal

from siren_ros.errors import InputError
from siren_ros.evaluation.network_file import card_path
from siren_ros.evaluation.prediction.predictors import checked
from siren_ros.evaluation.prediction.samples import future_times_s
from siren_ros.evaluation.prediction.siren_model.features import features_of
from siren_ros.evaluation.prediction.siren_model.siren_predictor import SHIPPED, load_network, make
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


@pytest.mark.parametrize("content", ["", "[]", "{}", "no json"])
def test_a_card_that_is_none_is_refused(copied, content) -> None:
    card_path(copied).write_text(content)
    with pytest.raises(InputError, match="checkpoint"):
        load_network(copied)


def test_other_versions_of_the_features_and_other_files_are_refused(copied, tmp_path) -> None:
    changed_card(copied, features_version=999)
    with pytest.raises(InputError, match="not 999"):
        load_network(copied)
    with pytest.raises(InputError, match="ONNX file"):
        load_network(tmp_path / "none.onnx")
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


MODEL = make()


def scene(network: RoadNetwork):
    tracks = {
        1: moving(-80.0, 0.2, 8.0),
        2: moving(-99.0, 0.0, 10.0, is_emv=True),
        3: moving(20.0, 30.0, 6.0, yaw_rad=np.pi / 2),
        4: moving(80.0, 0.0, 0.0),
    }
    return showing(batch_of(tracks, with_signal(network, "rGr")), "rGr")


def test_six_hypotheses_with_probabilities(crossroads: RoadNetwork) -> None:
    batch = scene(crossroads)
    found = checked("siren", MODEL.predict(batch), len(batch))
    assert found.xy_m.shape[1] == 6
    assert found.probability.sum(axis=1) == pytest.approx(1.0)


def test_predictions_turn_and_move_with_the_scene(crossroads: RoadNetwork) -> None:
    batch, angle, shift = scene(crossroads), 0.7, np.array([120.0, -80.0])
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    here, there = MODEL.predict(batch), MODEL.predict(moved(batch, angle, shift))
    assert there.probability == pytest.approx(here.probability, abs=1e-3)
    assert there.xy_m[:, 0] == pytest.approx(here.xy_m[:, 0] @ turn.T + shift, abs=0.02)


def test_the_lane_that_the_simulator_knows_is_not_used(crossroads: RoadNetwork) -> None:
    batch = scene(crossroads)
    other = replace(batch, actors=replace(batch.actors, past_sumo_lane=np.full_like(batch.actors.past_sumo_lane, 3)))
    assert (MODEL.predict(other).xy_m == MODEL.predict(batch).xy_m).all()


def test_who_drives_stays_on_the_road(straight_road: RoadNetwork) -> None:
    path = MODEL.predict(batch_of({1: moving(40.0, -5.25, 8.0)}, straight_road)).xy_m[:, 0]
    assert np.abs(path[..., 1] + 5.25).max() < 1.0
    assert (np.diff(path[..., 0], axis=1) > 0.0).all()


def test_who_stands_at_a_red_signal_stays_and_starts_at_a_green_one(crossroads: RoadNetwork) -> None:
    standing = batch_of({1: moving(-5.0, 0.0, 0.0)}, with_signal(crossroads, "rrr"))
    moved_m = [MODEL.predict(showing(standing, letters)).xy_m[0, 0, -1, 0] + 5.0 for letters in ("rrr", "GGG")]
    assert abs(moved_m[0]) < 1.0
    assert moved_m[1] > 5.0


def test_nobody_gives_no_hypothesis(crossroads: RoadNetwork) -> None:
    batch = batch_of({1: moving(0.0, 0.0, 5.0, steps=100)}, crossroads)
    assert MODEL.predict(batch).xy_m.shape[0] == 0
    assert MODEL.predict(batch).xy_m.shape[2:] == (len(future_times_s()), 2)


def test_the_card_tells_what_was_reached() -> None:
    card = json.loads(card_path(params_dir() / SHIPPED).read_text())
    assert card["variant"] == "full"
    assert (params_dir() / SHIPPED).stat().st_size < 5e6
    for split in ("test_seeds", "test_maps"):
        figures = card["figures"][split]["by_template"]
        assert figures["mean"]["siren"] <= 0.8 * figures["mean"]["cv"]
        assert figures["mean"]["siren_min6"] <= 0.6 * figures["mean"]["cv"]
        assert all(row["siren"] < min(row["cv"], row["idm"]) for row in figures.values())
