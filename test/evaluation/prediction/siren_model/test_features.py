from dataclasses import fields, replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from made_records import moving
from scenes import batch_of, lit, moved, showing, with_signal

from siren_ros.evaluation.prediction.samples import SampleBatch
from siren_ros.evaluation.prediction.siren_model.features import (
    Ablation,
    Features,
    features_and_names,
    features_of,
    without,
)
from siren_ros.roads.road_network import RoadNetwork
from siren_ros.world.actors import Lights


def scene(network: RoadNetwork):
    tracks = {
        1: moving(-60.0, 0.3, 8.0, accel_mps2=0.4),
        2: moving(-75.0, -0.5, 10.0, is_emv=True, length_m=6.0),
        3: moving(20.0, 30.0, 3.0, yaw_rad=np.pi / 2, first_step=40),
        4: moving(60.0, 0.0, 0.0),
        5: moving(300.0, 300.0, 5.0, yaw_rad=2.0),
    }
    batch = showing(batch_of(tracks, with_signal(network, "rGy")), "rGy")
    return lit(batch, 2, Lights.SIREN | Lights.BEACON)


@pytest.fixture(scope="module")
def here(crossroads: RoadNetwork) -> tuple[SampleBatch, Features]:
    """A few samples of the scene of all five vehicles."""
    whole = scene(crossroads)
    batch = replace(whole, target=whole.target[::9])
    return batch, features_of(batch)


@settings(max_examples=10, deadline=None)
@given(angle=st.floats(-3.1, 3.1), x=st.floats(-500.0, 500.0), y=st.floats(-500.0, 500.0))
def test_features_do_not_depend_on_where_the_scene_is(here: tuple[SampleBatch, Features], angle, x, y) -> None:
    batch, expected = here
    assert set(batch.actor_id.tolist()) == {1, 2, 3, 4, 5}
    there = features_of(moved(batch, angle, np.array([x, y])))
    for field in fields(Features):
        assert getattr(there, field.name) == pytest.approx(getattr(expected, field.name), abs=2e-4), field.name


def test_every_value_is_finite_and_has_a_name(crossroads: RoadNetwork) -> None:
    features, names = features_and_names(scene(crossroads))
    for kind in ("target", "neighbours", "paths"):
        assert getattr(features, kind).shape[-1] == len(getattr(names, kind)) == len(set(getattr(names, kind)))
    for field in fields(Features):
        assert np.isfinite(getattr(features, field.name)).all()
        assert getattr(features, field.name).dtype in (np.float32, np.bool_)


def test_a_sample_does_not_depend_on_what_else_is_in_the_batch(crossroads: RoadNetwork) -> None:
    together = scene(crossroads)
    whole = features_of(together)
    rows = np.arange(0, len(whole), 7)
    part = together.__class__(**{**vars(together), "target": together.target[rows]})
    for field in fields(Features):
        assert (getattr(features_of(part), field.name) == getattr(whole, field.name)[rows]).all(), field.name


def test_without_the_siren_beacon_and_siren_are_hidden_and_nothing_else(crossroads: RoadNetwork) -> None:
    batch = scene(crossroads)
    features, names = features_and_names(batch)
    dark = features_of(lit(batch, 2, Lights.NONE))
    hidden = without(features, names, Ablation.SIREN)
    assert (features.target != hidden.target).any()
    for field in fields(Features):
        assert (getattr(hidden, field.name) == getattr(dark, field.name)).all()


def test_without_the_map_there_are_no_paths(crossroads: RoadNetwork) -> None:
    features, names = features_and_names(scene(crossroads))
    hidden = without(features, names, Ablation.MAP)
    assert not hidden.path_there.any()
    assert not hidden.paths.any()
    assert not hidden.path_points_m.any()
    assert (hidden.target == features.target).all()
    assert without(features, names, Ablation.NONE) is features


def test_no_sample_gives_empty_features(crossroads: RoadNetwork) -> None:
    features = features_of(batch_of({1: moving(0.0, 0.0, 5.0, steps=100)}, crossroads))
    assert len(features) == 0
    assert features.paths.ndim == 3


def test_where_there_is_no_path_or_neighbour_all_values_are_none(crossroads: RoadNetwork) -> None:
    features = features_of(scene(crossroads))
    assert not features.path_there.all()
    assert not features.neighbour_there.all()
    assert not features.path_points_m[~features.path_there].any()
    assert not features.paths[~features.path_there].any()
    assert not features.neighbours[~features.neighbour_there].any()
