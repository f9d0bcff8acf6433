"""Argoverse 2's own metric functions on random multi-modal predictions."""

from pathlib import Path

import numpy as np
import pytest
from made_scores import scored
from reader_environments import read_with

from siren_ros.evaluation.prediction.metrics import METRIC_OF
from siren_ros.evaluation.prediction.predictors import Hypotheses

SAMPLES = 300


@pytest.fixture(scope="module")
def given() -> tuple[Hypotheses, np.ndarray]:
    """Six hypotheses of unequal probability around each truth; about half of the samples are misses."""
    rng = np.random.default_rng(11)
    truth = np.cumsum(rng.normal(scale=1.0, size=(SAMPLES, 25, 2)), axis=1) + rng.uniform(-500, 500, (SAMPLES, 1, 2))
    noise = np.cumsum(rng.normal(scale=0.6, size=(SAMPLES, 6, 25, 2)), axis=2)
    return Hypotheses.ranked(truth[:, None] + noise, rng.dirichlet(np.ones(6), SAMPLES)), truth


@pytest.fixture(scope="module")
def theirs(given: tuple[Hypotheses, np.ndarray], tmp_path_factory: pytest.TempPathFactory) -> dict[str, np.ndarray]:
    hypotheses, truth = given
    path: Path = tmp_path_factory.mktemp("metrics") / "given.npz"
    np.savez(path, paths=hypotheses.xy_m, truth=truth, probability=hypotheses.probability)
    found = read_with("av2", "read_argoverse2_metrics.py", path)
    return {name: np.array(values) for name, values in found.items()}


@pytest.mark.parametrize("name", ["ade_m", "fde_m", "min_ade_6_m", "min_fde_6_m", "miss_rate_6", "brier_min_fde_6_m"])
def test_every_sample_has_their_value(
    name: str, given: tuple[Hypotheses, np.ndarray], theirs: dict[str, np.ndarray]
) -> None:
    hypotheses, truth = given
    best = np.arange(SAMPLES), theirs["fde"].argmin(axis=1)
    expected = {
        "ade_m": theirs["ade"][:, 0],
        "fde_m": theirs["fde"][:, 0],
        "min_ade_6_m": theirs["ade"].min(axis=1),
        "min_fde_6_m": theirs["fde"].min(axis=1),
        "miss_rate_6": theirs["missed"].min(axis=1),
        "brier_min_fde_6_m": theirs["brier_fde"][best],
    }[name]
    ours = METRIC_OF[name].of_samples(hypotheses, scored(truth))
    assert np.abs(ours - expected).max() < 1e-9
    assert 0.2 < theirs["missed"].min(axis=1).mean() < 0.8, "both kinds are there"
