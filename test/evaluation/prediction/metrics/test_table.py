"""All metrics: what they share, and Argoverse 2's functions on the same hypotheses."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from made_scores import scored

from siren_ros.evaluation.prediction.metrics.table import METRIC_OF, METRICS
from siren_ros.evaluation.prediction.protocol.hypotheses import Hypotheses


def random_hypotheses(seed: int, samples: int, modes: int) -> tuple[Hypotheses, np.ndarray]:
    """Hypotheses around a truth near the origin, some within 2 m of its end."""
    rng = np.random.default_rng(seed)
    truth = rng.normal(scale=3.0, size=(samples, 25, 2))
    paths = truth[:, None] + rng.normal(scale=2.0, size=(samples, modes, 25, 2))
    return Hypotheses.ranked(paths, rng.dirichlet(np.ones(modes), samples)), truth


@pytest.mark.parametrize("metric", METRICS, ids=lambda metric: metric.name)
def test_without_samples_there_is_no_value(metric) -> None:
    value = metric.compute(Hypotheses.certain(np.zeros((0, 25, 2))), scored(np.zeros((0, 25, 2))))
    assert not value.valid
    assert value.samples == 0
    assert np.isfinite(value.value)


@pytest.mark.parametrize("metric", METRICS, ids=lambda metric: metric.name)
def test_a_sample_counts_alone(metric) -> None:
    """Values of some samples do not depend on the others, collisions of other frames included."""
    hypotheses, truth = random_hypotheses(3, 12, 6)
    whole = metric.of_samples(hypotheses, scored(truth))
    part = metric.of_samples(hypotheses.select(np.arange(4, 8)), scored(truth[4:8]))
    assert np.array_equal(whole[4:8], part, equal_nan=True)


@given(seed=st.integers(0, 1000), modes=st.integers(1, 9))
def test_the_mean_of_squares_is_rooted_at_the_end(seed: int, modes: int) -> None:
    hypotheses, truth = random_hypotheses(seed, 9, modes)
    rmse = METRIC_OF["rmse_5s_m"].compute(hypotheses, scored(truth)).value
    assert rmse >= METRIC_OF["fde_m"].compute(hypotheses, scored(truth)).value - 1e-12
    assert rmse == pytest.approx(np.sqrt((METRIC_OF["fde_m"].of_samples(hypotheses, scored(truth)) ** 2).mean()))
