"""The plan of the episodes, and the samples that they give."""

from dataclasses import fields
from itertools import combinations

import numpy as np
import pytest
from made_training_data import made_record

from siren_ros.data.episode_source import open_source
from siren_ros.errors import InputError
from siren_ros.lab.training.prediction.samples import (
    PlanSize,
    features_of_record,
    is_ordinary,
    plan_bags,
    plan_episodes,
    read_features,
    read_store,
    without_lamps,
    write_features,
)
from siren_ros.scoring.evaluation.prediction.baselines import ConstantVelocity
from siren_ros.scoring.evaluation.prediction.samples import HistoryWindow, Population, samples_of
from siren_ros.scoring.evaluation.prediction.siren_model.siren_predictor import Ablation, Features
from siren_ros.simulation.scenario.episode import EpisodeIdentity, Split, split_of
from siren_ros.simulation.scenario.paper import TEMPLATES, EmergencyLevel

MAPS, HELD_OUT = ["", "maps/a.xodr", "maps/b.osm.gz"], ["maps/c.xodr"]
PLAN = plan_episodes(MAPS, HELD_OUT, PlanSize(train=10, validation=2, test=3))


def of(split):
    return [planned for planned in PLAN if planned.split is split]


def test_no_map_and_seed_serves_two_splits() -> None:
    places = {split: {episode.identity for episode in of(split)} for split in Split}
    assert all(not places[first] & places[second] for first, second in combinations(Split, 2))
    trained = {episode.request.seed for episode in of(Split.TRAIN)}
    assert not trained & {episode.request.seed for split in Split if split is not Split.TRAIN for episode in of(split)}
    assert {episode.request.map for episode in of(Split.TEST_MAP)} == set(HELD_OUT)
    others = [episode for episode in PLAN if episode.split is not Split.TEST_MAP]
    assert {episode.request.map for episode in others} == set(MAPS)
    assert all(episode.split is split_of(episode.identity) for episode in others)
    assert len({(episode.split, episode.name) for episode in PLAN}) == len(PLAN)
    for maps, held_out in ((["maps/Town07.xodr"], []), (["", "a.xodr"], ["a.xodr"])):
        with pytest.raises(InputError, match="maps"):
            plan_episodes(maps, held_out, PlanSize())


def test_every_template_is_there_as_often_as_asked_for() -> None:
    for split, maps, seeds in zip(tuple(Split)[:4], (3, 3, 3, 1), (10, 2, 3, 3), strict=True):
        templates = [episode.request.template for episode in of(split)]
        assert {template: templates.count(template) for template in TEMPLATES} == dict.fromkeys(TEMPLATES, maps * seeds)


def test_training_has_all_levels_and_the_others_the_templates_own() -> None:
    levels = [episode.request.level for episode in of(Split.TRAIN)]
    assert set(levels) == {"", *EmergencyLevel.__members__}
    assert levels.count("") == len(levels) / 2
    assert sum(is_ordinary(episode.request) for episode in of(Split.TRAIN)) == len(levels) / 5
    assert {episode.request.level for episode in PLAN if episode.split is not Split.TRAIN} == {""}


def test_own_bags_are_in_the_splits_that_are_fixed_for_them(tmp_path, write_bag) -> None:
    bags = [write_bag(tmp_path / f"bag{civilians}", duration_s=2.0, civilians=civilians) for civilians in (2, 3)]
    planned = plan_bags(bags)
    for one, bag in zip(planned, bags, strict=True):
        with open_source(bag) as source:
            identity = EpisodeIdentity.of(source.description)
        assert (one.bag, one.identity, one.split) == (bag, identity, split_of(identity))
    assert len({one.name for one in planned}) == 2, "bags of the same episode name have files of their own"


def test_what_is_written_is_read_again(tmp_path) -> None:
    written = features_of_record(made_record(1), Split.TEST_MAP)
    write_features(tmp_path / "new" / "one.npz", written)
    read = read_features(tmp_path / "new" / "one.npz")
    assert (read.episode, read.split, read.names) == (written.episode, written.split, written.names)
    for field in fields(Features):
        assert (getattr(read.features, field.name) == getattr(written.features, field.name)).all()
        assert getattr(read.features, field.name).dtype == getattr(written.features, field.name).dtype
    assert (read.truth_m == written.truth_m).all()
    errors, expected = read.reference_ade_m, written.reference_ade_m
    assert {name: errors[name].tolist() for name in errors} == {name: expected[name].tolist() for name in expected}
    assert [path.name for path in (tmp_path / "new").iterdir()] == ["one.npz"]


def test_reference_errors_are_those_of_the_protocol() -> None:
    record = made_record(2)
    errors_m = features_of_record(record, Split.TEST_SEED).reference_ade_m
    samples = samples_of(record, HistoryWindow(), Population.REGION)
    miss = ConstantVelocity().predict(samples.batch).xy_m[:, 0] - samples.future_xy_m
    assert errors_m["cv"] == pytest.approx(np.hypot(miss[..., 0], miss[..., 1]).mean(axis=1), abs=1e-5)
    assert set(errors_m) == {"cv", "idm"}


def test_each_drawn_sample_comes_without_errors_and_with_those_of_a_tracker() -> None:
    """Of the vehicles at constant heading 0, those with a noisy heading see the truth turned."""
    drawn, again = (features_of_record(made_record(3), Split.TRAIN) for _ in range(2))
    assert (drawn.features.target == again.features.target).all(), "they are the same every time"
    turned = np.abs(drawn.truth_m[:, -1, 1]) > 1e-3
    assert turned.mean() == pytest.approx(0.5, abs=0.02)
    assert len(drawn) % 2 == 0
    truth_m = features_of_record(made_record(3), Split.VAL).truth_m
    assert truth_m[..., 1] == pytest.approx(0.0, abs=1e-4)
    assert (truth_m[:, -1, 0] > 0.0).all()


def test_samples_stand_in_the_order_of_their_files(episode_files) -> None:
    paths = episode_files[Split.TRAIN]
    store = read_store(paths)
    episodes = [read_features(path) for path in paths]
    assert len(store) == sum(map(len, episodes))
    assert store.episodes == tuple(episode.episode for episode in episodes)
    rows = np.flatnonzero(store.episode == 2)
    batch = store.batch(rows)
    assert batch.target.dtype == np.float32
    assert batch.target == pytest.approx(episodes[2].features.target, abs=2e-3)
    assert batch.path_there.tolist() == episodes[2].features.path_there.tolist()
    assert (store.truth_m[rows] == episodes[2].truth_m).all()


def test_reference_errors_come_with_episodes_that_judge_and_an_ablation_hides_its_input(episode_files) -> None:
    assert set(read_store(episode_files[Split.TEST_SEED]).reference_ade_m) == {"cv", "idm"}
    store = read_store(episode_files[Split.TRAIN], Ablation.MAP)
    assert store.reference_ade_m == {}
    assert not store.features.path_there.any()


def test_lamps_can_be_hidden_from_some_samples(episode_files) -> None:
    store = read_store(episode_files[Split.TRAIN])
    for kind in ("target", "neighbours"):
        getattr(store.features, kind)[:] = 1.0
    hidden = np.arange(len(store)) % 3 == 0
    seen = without_lamps(store, hidden)
    for kind in ("target", "neighbours"):
        before, values = (getattr(each.features, kind) for each in (store, seen))
        assert (before == 1.0).all(), "the store itself stays"
        assert (values[~hidden] == 1.0).all()
        names = {
            name for name, column in zip(getattr(store.names, kind), values[hidden].T, strict=True) if not column.any()
        }
        assert names == {"brake", "indicates_left", "indicates_right"}
