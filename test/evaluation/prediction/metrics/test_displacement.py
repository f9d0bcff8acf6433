import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from siren_ros.evaluation.prediction.metrics.displacement import (
    ade,
    fde,
    min_ade_6,
    min_fde_6,
    squared_fde,
)
from siren_ros.evaluation.prediction.protocol.hypotheses import Hypotheses

TRUTH = np.zeros((2, 4, 2))


def sure(xy_m: np.ndarray) -> Hypotheses:
    """Hypotheses of equal probability, in the given order."""
    return Hypotheses.ranked(xy_m, np.ones(xy_m.shape[:2]))


def shifted(*offsets_m: float) -> np.ndarray:
    """One hypothesis for each offset in y, for both samples."""
    hypotheses = np.zeros((2, len(offsets_m), 4, 2))
    hypotheses[..., 1] = np.array(offsets_m)[None, :, None]
    return hypotheses


def test_distances_are_euclidean() -> None:
    hypotheses = np.zeros((2, 1, 4, 2))
    hypotheses[0] = (3.0, 4.0)
    assert ade(sure(hypotheses), TRUTH).mean() == pytest.approx(2.5)
    assert fde(sure(hypotheses), TRUTH).mean() == pytest.approx(2.5)
    assert squared_fde(sure(hypotheses), TRUTH).tolist() == [25.0, 0.0]


def test_ade_takes_all_times_and_fde_the_last() -> None:
    hypotheses = np.zeros((2, 1, 4, 2))
    hypotheses[:, 0, :, 0] = (1.0, 2.0, 3.0, 6.0)
    assert ade(sure(hypotheses), TRUTH).mean() == pytest.approx(3.0)
    assert fde(sure(hypotheses), TRUTH).mean() == pytest.approx(6.0)


def test_the_first_hypothesis_counts_and_for_the_best_of_six_the_first_six() -> None:
    hypotheses = shifted(7.0, 6.0, 5.0, 4.0, 3.0, 2.0, 1.0)
    assert ade(sure(hypotheses), TRUTH).mean() == pytest.approx(7.0)
    assert fde(sure(hypotheses), TRUTH).mean() == pytest.approx(7.0)
    assert squared_fde(sure(hypotheses), TRUTH).mean() == pytest.approx(49.0)
    assert min_ade_6(sure(hypotheses), TRUTH).mean() == pytest.approx(2.0)
    assert min_fde_6(sure(hypotheses), TRUTH).mean() == pytest.approx(2.0)


def test_each_best_of_six_chooses_for_itself() -> None:
    hypotheses = shifted(2.0, 1.0)
    hypotheses[:, 0, -1] = 0.0
    assert min_ade_6(sure(hypotheses), TRUTH).mean() == pytest.approx(1.0)
    assert min_fde_6(sure(hypotheses), TRUTH).mean() == pytest.approx(0.0)


@given(seed=st.integers(0, 1000), k=st.integers(1, 8))
def test_order_of_the_metrics(seed: int, k: int) -> None:
    rng = np.random.default_rng(seed)
    hypotheses, truth = sure(rng.normal(size=(5, k, 25, 2))), rng.normal(size=(5, 25, 2))
    assert (min_ade_6(hypotheses, truth) <= ade(hypotheses, truth) + 1e-12).all()
    assert (min_fde_6(hypotheses, truth) <= fde(hypotheses, truth) + 1e-12).all()
    if k == 1:
        assert np.array_equal(min_ade_6(hypotheses, truth), ade(hypotheses, truth))
        assert np.array_equal(min_fde_6(hypotheses, truth), fde(hypotheses, truth))
