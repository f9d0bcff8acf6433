import hashlib
import json
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
from busy_record import busy_record
from hypothesis import given, settings
from hypothesis import strategies as st
from known_outputs import assert_known
from made_records import moving
from scenes import batch_of, lit, moved, showing, with_signal

from siren_ros.base.params.folders import params_dir
from siren_ros.base.params.plain_files import card_path
from siren_ros.errors import InputError
from siren_ros.scoring.evaluation.prediction.predictors import checked
from siren_ros.scoring.evaluation.prediction.samples import HistoryWindow, Population, samples_of
from siren_ros.scoring.evaluation.prediction.siren_model.siren_predictor import (
    SHIPPED,
    Ablation,
    Features,
    features_and_names,
    load_network,
    make,
    without,
)
from siren_ros.simulation.roads.road_network import MIRROR, RoadNetwork, mirrored_network
from siren_ros.simulation.world.actors import Lights


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


def test_other_versions_of_the_features_and_other_files_are_refused(copied, tmp_path) -> None:
    card = card_path(copied).read_text()
    for content in ("", "[]", "{}", "no json"):
        card_path(copied).write_text(content)
        with pytest.raises(InputError, match="checkpoint"):
            load_network(copied)
    card_path(copied).write_text(card)
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


MODEL = make()


def scene(network):
    """All five vehicles at a signal; the emergency vehicle with beacon and siren."""
    tracks = {
        1: moving(-60.0, 0.3, 8.0, accel_mps2=0.4),
        2: moving(-75.0, -0.5, 10.0, is_emv=True, length_m=6.0),
        3: moving(20.0, 30.0, 3.0, yaw_rad=np.pi / 2, first_step=40),
        4: moving(60.0, 0.0, 0.0),
        5: moving(300.0, 300.0, 5.0, yaw_rad=2.0),
    }
    return lit(showing(batch_of(tracks, with_signal(network, "rGy")), "rGy"), 2, Lights.SIREN | Lights.BEACON)


def features_of(batch):
    return features_and_names(batch)[0]


def values_of(features):
    """The arrays of some samples by their names."""
    return {field.name: getattr(features, field.name) for field in fields(Features)}


def test_predictions_turn_and_move_with_the_scene(crossroads) -> None:
    batch, angle, shift = scene(crossroads), 0.7, np.array([120.0, -80.0])
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    here = checked("siren", MODEL.predict(batch), len(batch))
    there = MODEL.predict(moved(batch, angle, shift))
    assert here.xy_m.shape[1] == 6
    assert there.probability == pytest.approx(here.probability, abs=1e-3)
    assert there.xy_m[:, 0] == pytest.approx(here.xy_m[:, 0] @ turn.T + shift, abs=0.02)


def test_where_traffic_keeps_left_predictions_are_mirrored(crossroads) -> None:
    batch = lit(scene(crossroads), 1, Lights.INDICATOR_LEFT)
    actors = replace(
        batch.actors,
        lights=np.where(batch.actors.lights == Lights.INDICATOR_LEFT, Lights.INDICATOR_RIGHT, batch.actors.lights),
        xy_m=batch.actors.xy_m * MIRROR,
        velocity_mps=batch.actors.velocity_mps * MIRROR,
        yaw_rad=-batch.actors.yaw_rad,
    )
    image = replace(batch, network=mirrored_network(batch.network), actors=actors)
    for name, values in vars(image.right_hand.actors).items():
        np.testing.assert_array_equal(values, getattr(batch.actors, name), err_msg=name)
    here, there = MODEL.predict(batch), MODEL.predict(image)
    assert (there.xy_m == here.xy_m * MIRROR).all()
    assert (there.probability == here.probability).all()


def test_the_lane_that_the_simulator_knows_is_not_used(crossroads) -> None:
    batch = scene(crossroads)
    other = replace(batch, actors=replace(batch.actors, past_sumo_lane=np.full_like(batch.actors.past_sumo_lane, 3)))
    assert (MODEL.predict(other).xy_m == MODEL.predict(batch).xy_m).all()


def test_a_vehicle_at_a_red_signal_stays_and_starts_at_a_green_one(crossroads) -> None:
    standing = batch_of({1: moving(-5.0, 0.0, 0.0)}, with_signal(crossroads, "rrr"))
    moved_m = [MODEL.predict(showing(standing, letters)).xy_m[0, 0, -1, 0] + 5.0 for letters in ("rrr", "GGG")]
    assert abs(moved_m[0]) < 1.0
    assert moved_m[1] > 5.0


@pytest.mark.parametrize("with_map", [False, True])
def test_without_samples_there_are_empty_features_and_no_hypothesis(crossroads, with_map) -> None:
    network = crossroads if with_map else RoadNetwork((), (), (), {}, (0.0, 0.0), "!")
    batch = batch_of({1: moving(0.0, 0.0, 5.0, steps=100)}, network)
    features = features_of(batch)
    assert len(features) == 0
    assert features.paths.ndim == 3
    xy_m, probability = MODEL.network.run(features)
    assert (xy_m.shape, probability.shape) == ((0, 1, 25, 2), (0, 1))
    assert MODEL.predict(batch).xy_m.shape == (0, 1, 25, 2)


@pytest.fixture(scope="module")
def some_samples(crossroads):
    """A few samples of the scene of all five vehicles, and their features."""
    whole = scene(crossroads)
    batch = replace(whole, target=whole.target[::9])
    return batch, values_of(features_of(batch))


@settings(max_examples=10, deadline=None)
@given(angle=st.floats(-3.1, 3.1), x=st.floats(-500.0, 500.0), y=st.floats(-500.0, 500.0))
def test_features_do_not_depend_on_where_the_scene_is(some_samples, angle, x, y) -> None:
    batch, expected = some_samples
    assert set(batch.actor_id.tolist()) == {1, 2, 3, 4, 5}
    for name, values in values_of(features_of(moved(batch, angle, np.array([x, y])))).items():
        assert values == pytest.approx(expected[name], abs=2e-4), name


def test_every_value_is_finite_and_has_a_name(crossroads) -> None:
    features, names = features_and_names(scene(crossroads))
    for kind in ("target", "neighbours", "paths"):
        assert getattr(features, kind).shape[-1] == len(getattr(names, kind)) == len(set(getattr(names, kind)))
    for values in values_of(features).values():
        assert np.isfinite(values).all()
        assert values.dtype in (np.float32, np.bool_)
    for kind, there in (("paths", "path_there"), ("path_points_m", "path_there"), ("neighbours", "neighbour_there")):
        assert not getattr(features, there).all()
        assert not getattr(features, kind)[~getattr(features, there)].any()


def test_a_sample_does_not_depend_on_what_else_is_in_the_batch(crossroads) -> None:
    batch = scene(crossroads)
    rows = np.arange(0, len(batch), 7)
    part = values_of(features_of(replace(batch, target=batch.target[rows])))
    for name, values in values_of(features_of(batch)).items():
        assert (part[name] == values[rows]).all(), name


def test_without_the_siren_beacon_and_siren_are_hidden_and_nothing_else(crossroads) -> None:
    batch = scene(crossroads)
    features, names = features_and_names(batch)
    dark = values_of(features_of(lit(batch, 2, Lights.NONE)))
    hidden = without(features, names, Ablation.SIREN)
    assert (features.target != hidden.target).any()
    assert all((values == dark[name]).all() for name, values in values_of(hidden).items())


def test_without_the_map_there_are_no_paths(crossroads) -> None:
    features, names = features_and_names(scene(crossroads))
    hidden = without(features, names, Ablation.MAP)
    assert not any(values.any() for values in (hidden.path_there, hidden.paths, hidden.path_points_m))
    assert (hidden.target == features.target).all()
    assert without(features, names, Ablation.NONE) is features


@pytest.mark.parametrize("side", ["right", "left"])
def test_where_the_shipped_network_sees_vehicles_and_people_go(side: str) -> None:
    """The best three ways of five samples after 1, 3 and 5 s, to three digits: processors differ behind them."""
    record = busy_record()
    if side == "left":
        record = replace(record.mirrored(), network=replace(record.mirrored().network, left_hand=True))
    batch = samples_of(record, HistoryWindow(), Population.ALL).batch
    answer = make().predict(batch)
    ways = (answer.xy_m[5::171, :3, 4::10] - batch.xy_m[5::171, None, None]).reshape(-1, 18)
    found = {"actor_id": batch.actor_id[5::171], "ways_m": ways, "probability": answer.probability[5::171, :3]}
    assert_known(Path(__file__).parent / "known" / f"siren_{side}.json", found, digits=3, decimals=2)
