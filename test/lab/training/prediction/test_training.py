from types import SimpleNamespace

import numpy as np
import pytest

from siren_ros.lab.training.prediction.samples import EpisodeKey, read_store
from siren_ros.lab.training.prediction.training import (
    MEAN,
    EpisodeErrors,
    assess,
    by_map,
    by_template,
    errors_json,
    table_lines,
)
from siren_ros.simulation.scenario.episode import Split


def errors(template: str, map_name: str, siren: float, samples: int = 10) -> EpisodeErrors:
    values = {"siren": siren, "siren_min6": siren / 2, "siren_fde": 3 * siren, "cv": 2.0, "idm": 3.0}
    return EpisodeErrors(EpisodeKey(template, "L1", 7, map_name), samples, values)


def test_every_template_counts_once() -> None:
    table = by_template([errors("S1", "a", 1.0), errors("S1", "b", 3.0), errors("S2", "a", 4.0)])
    assert by_template([]) == {}, "nothing to judge gives no table"
    assert table["S1"]["siren"] == 2.0
    assert table["S1"]["episodes"] == 2.0
    assert table[MEAN]["siren"] == 3.0
    assert by_template([errors("S1", "a", 1.0, 30), errors("S1", "b", 5.0, 10)])["S1"]["siren"] == 2.0
    assert by_map([errors("S1", "a", 1.0), errors("S2", "a", 2.0), errors("S1", "b", 5.0)])["b"]["siren"] == 5.0


def test_the_table_shows_gains_over_constant_velocity() -> None:
    lines = table_lines(by_template([errors("S1", "a", 1.0)]))
    assert lines[1].split() == ["S1", "1", "2.00", "3.00", "1.00", "-50%", "0.50", "-75%"]
    assert errors_json([errors("S1", "a", 1.0)])["by_template"]["S1"]["cv"] == 2.0


def test_the_error_of_the_most_probable_and_of_the_best_hypothesis(episode_files) -> None:
    store = read_store(episode_files[Split.TEST_SEED])

    def run(features):
        # One hypothesis 1 m to the side, one exact; the first is called the more probable in every second sample.
        paths = np.stack((store.truth_m + np.array([0.0, 1.0]), store.truth_m), axis=1)
        first = np.arange(len(features)) % 2 == 0
        return paths, np.where(first[:, None], [[0.7, 0.3]], [[0.3, 0.7]])

    episodes = assess(SimpleNamespace(run=run), store)
    assert [each.samples for each in episodes] == [int((store.episode == number).sum()) for number in range(2)]
    total_m = sum(each.samples * each.errors_m["siren"] for each in episodes)
    assert total_m == pytest.approx(np.ceil(len(store) / 2), abs=1e-3)
    assert all(each.errors_m["siren_min6"] == pytest.approx(0.0, abs=1e-6) for each in episodes)
    assert all(each.errors_m["siren"] == pytest.approx(each.errors_m["siren_fde"]) for each in episodes)
