import json
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("torch", reason="the extra models is not installed")
pytest.importorskip("onnx", reason="the extra models is not installed")

from hand_made import made_record

from siren_ros.errors import InputError
from siren_ros.evaluation.prediction.predictors import checked
from siren_ros.evaluation.prediction.samples import HistoryWindow, Population, samples_of
from siren_ros.evaluation.prediction.siren_model.siren_predictor import make
from siren_ros.scenario.episode import EpisodeRequest
from siren_ros.training.data_files import MadeFiles
from siren_ros.training.fitting.prediction import fitted_network
from siren_ros.training.prediction.plan import PlannedEpisode, Split
from siren_ros.training.prediction.training import train_variant, with_ablations
from siren_ros.training.settings import FitConfig

CONFIG = FitConfig(epochs=2, batch=64, width=16, layers=1)


@pytest.fixture(scope="module")
def data(episode_files):
    planned = [
        (PlannedEpisode(split, EpisodeRequest(seed=number, level="L0" if number % 2 else "")), path)
        for split, paths in episode_files.items()
        for number, path in enumerate(paths)
    ]
    return MadeFiles(tuple(planned), ((PlannedEpisode(Split.TRAIN, EpisodeRequest(seed=99)), "map: no site"),))


def test_a_trained_variant_can_be_used_as_a_predictor(data, tmp_path) -> None:
    lines = []
    trained = train_variant("full", data, tmp_path, CONFIG, fitted_network, lines.append)
    assert len(lines) == 1 + CONFIG.epochs
    card = json.loads((tmp_path / "full.json").read_text())
    assert card["figures"]["test_seeds"]["samples"] > 0
    assert card["training"]["episodes"] == 6
    assert card["data"]["train"]["left_out"] == ["S2_own_town_seed99: map: no site"]
    batch = samples_of(made_record(30), HistoryWindow(), Population.REGION).batch
    predicted = make(trained.path).predict(batch)
    checked("siren", predicted, len(batch))
    assert predicted.xy_m.shape[1] == 6
    # The file and the network in memory answer alike: the same errors again.
    assert trained.errors[Split.TEST_SEEDS][0].samples > 0


def test_variants_train_on_what_they_say(data, tmp_path) -> None:
    full = train_variant("full", data, tmp_path, CONFIG, fitted_network, lambda _: None)
    others = [
        train_variant(name, data, tmp_path, CONFIG, fitted_network, lambda _: None) for name in ("ordinary", "few")
    ]
    assert [other.card["training"]["episodes"] for other in others] == [3, 3]
    with_ablations(full, others)
    card = json.loads((tmp_path / "full.json").read_text())
    assert set(card["ablations"]) == {"ordinary", "few"}
    assert np.isfinite(card["ablations"]["few"]["test_seeds"]["mean"]["siren"])


def test_without_an_episode_nothing_can_be_trained(data, tmp_path) -> None:
    with pytest.raises(InputError, match="at least one"):
        train_variant("full", replace(data, files=()), tmp_path, CONFIG, fitted_network, lambda _: None)
