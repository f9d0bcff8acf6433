from dataclasses import fields

import numpy as np
import pytest
from hand_made import made_record

from siren_ros.evaluation.prediction.baselines import ConstantVelocity
from siren_ros.evaluation.prediction.samples import HistoryWindow, Population, samples_of
from siren_ros.evaluation.prediction.siren_model.siren_predictor import Ablation, Features
from siren_ros.training.prediction.batches import read_store
from siren_ros.training.prediction.samples import features_of_record, read_features, write_features
from siren_ros.training.settings import Split


def test_what_is_written_is_read_again(tmp_path) -> None:
    made = features_of_record(made_record(1), Split.TEST_MAPS)
    write_features(tmp_path / "new" / "one.npz", made)
    read = read_features(tmp_path / "new" / "one.npz")
    assert (read.template, read.level, read.seed, read.map_name, read.split, read.names) == (
        made.template,
        made.level,
        made.seed,
        made.map_name,
        made.split,
        made.names,
    )
    for field in fields(Features):
        assert (getattr(read.features, field.name) == getattr(made.features, field.name)).all()
        assert getattr(read.features, field.name).dtype == getattr(made.features, field.name).dtype
    assert (read.truth_m == made.truth_m).all()
    assert {name: values.tolist() for name, values in read.reference_ade_m.items()} == {
        name: values.tolist() for name, values in made.reference_ade_m.items()
    }
    assert [path.name for path in (tmp_path / "new").iterdir()] == ["one.npz"]


def test_the_truth_is_seen_from_the_vehicle() -> None:
    made = features_of_record(made_record(1), Split.TEST_SEEDS)
    assert (made.truth_m[:, -1, 0] > 0.0).all()
    assert made.truth_m[..., 1] == pytest.approx(0.0, abs=1e-4)


def test_reference_errors_are_those_of_the_protocol() -> None:
    record = made_record(2)
    made = features_of_record(record, Split.TEST_SEEDS)
    samples = samples_of(record, HistoryWindow(), Population.REGION)
    miss = ConstantVelocity().predict(samples.batch).xy_m[:, 0] - samples.future_xy_m
    assert made.reference_ade_m["cv"] == pytest.approx(np.hypot(miss[..., 0], miss[..., 1]).mean(axis=1), abs=1e-5)
    assert set(made.reference_ade_m) == {"cv", "idm"}


def test_training_draws_the_same_samples_every_time() -> None:
    one, other = (features_of_record(made_record(3), Split.TRAIN) for _ in range(2))
    assert (one.features.target == other.features.target).all()
    assert one.reference_ade_m == {}


def test_samples_stand_in_the_order_of_their_files(episode_files) -> None:
    paths = episode_files[Split.TRAIN]
    store = read_store(paths)
    episodes = [read_features(path) for path in paths]
    assert len(store) == sum(map(len, episodes))
    assert [(key.template, key.seed) for key in store.episodes] == [(each.template, each.seed) for each in episodes]
    rows = np.flatnonzero(store.episode == 2)
    batch = store.batch(rows)
    assert batch.target.dtype == np.float32
    assert batch.target == pytest.approx(episodes[2].features.target, abs=2e-3)
    assert batch.path_there.tolist() == episodes[2].features.path_there.tolist()
    assert (store.truth_m[rows] == episodes[2].truth_m).all()


def test_reference_errors_come_with_episodes_that_judge(episode_files) -> None:
    assert set(read_store(episode_files[Split.TEST_SEEDS]).reference_ade_m) == {"cv", "idm"}
    assert read_store(episode_files[Split.TRAIN]).reference_ade_m == {}


def test_an_ablation_hides_its_input(episode_files) -> None:
    store = read_store(episode_files[Split.TRAIN], Ablation.MAP)
    assert not store.features.path_there.any()
