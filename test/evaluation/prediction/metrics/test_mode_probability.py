import numpy as np
import pytest

from siren_ros.evaluation.prediction.metrics.mode_probability import brier_min_fde_6, brier_score
from siren_ros.evaluation.prediction.protocol.hypotheses import Hypotheses

TRUTH = np.zeros((1, 25, 2))


def ending(*ends_m: float, probability: tuple[float, ...]) -> Hypotheses:
    """Hypotheses of one sample that end at given distances."""
    paths = np.zeros((1, len(ends_m), 25, 2))
    paths[0, :, -1, 0] = ends_m
    return Hypotheses(paths, np.array([probability]))


def test_by_hand() -> None:
    hypotheses = ending(3.0, 1.0, probability=(0.75, 0.25))
    assert brier_min_fde_6(hypotheses, TRUTH)[0] == pytest.approx(1.0 + 0.75**2)
    assert brier_score(hypotheses, TRUTH)[0] == pytest.approx(2.0 * 0.75**2)


def test_to_be_sure_and_right_costs_nothing() -> None:
    hypotheses = ending(0.5, 9.0, probability=(1.0, 0.0))
    assert brier_min_fde_6(hypotheses, TRUTH)[0] == pytest.approx(0.5)
    assert brier_score(hypotheses, TRUTH)[0] == 0.0


def test_six_hypotheses_are_scaled_to_the_sum_one() -> None:
    hypotheses = ending(*range(1, 9), probability=(0.125,) * 8)
    assert brier_min_fde_6(hypotheses, TRUTH)[0] == pytest.approx(1.0 + (5.0 / 6.0) ** 2)
    assert brier_score(hypotheses, TRUTH)[0] == pytest.approx((5.0 / 6.0) ** 2 + 5.0 / 36.0)


def test_a_single_hypothesis_states_nothing() -> None:
    hypotheses = ending(2.0, probability=(1.0,))
    assert np.isnan(brier_score(hypotheses, TRUTH)).all()
    assert brier_min_fde_6(hypotheses, TRUTH).tolist() == [2.0]
