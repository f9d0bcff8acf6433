import numpy as np
import pytest

from siren_ros.evaluation.prediction.siren_model.features import Ablation
from siren_ros.training.episode_features import read_features
from siren_ros.training.episode_plan import Split
from siren_ros.training.sample_store import read_store


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
