import numpy as np
import pytest

from siren_ros.evaluation.prediction.metrics.calibration import calibration_error, no_reliability, reliability_of
from siren_ros.evaluation.prediction.protocol.hypotheses import Hypotheses


def two_modes(samples: int, first_best: int, probability: float) -> tuple[Hypotheses, np.ndarray]:
    """Samples with two hypotheses; in the first ones of them the more probable is the best."""
    paths = np.zeros((samples, 2, 25, 2))
    paths[:first_best, 1] = 5.0
    paths[first_best:, 0] = 5.0
    stated = np.broadcast_to([probability, 1.0 - probability], (samples, 2)).copy()
    return Hypotheses(paths, stated), np.zeros((samples, 25, 2))


def test_a_calibrated_model_has_no_error() -> None:
    assert calibration_error(reliability_of(*two_modes(100, 75, 0.75))).value == pytest.approx(0.0)


def test_the_error_of_a_model_that_is_too_sure() -> None:
    found = calibration_error(reliability_of(*two_modes(100, 60, 0.95)))
    assert found.value == pytest.approx(0.35)
    assert found.samples == 200, "hypotheses"


def test_counts_add_up() -> None:
    parts = [reliability_of(*two_modes(10, best, 0.75)) for best in (5, 10)]
    assert calibration_error(parts[0] + parts[1]).value == pytest.approx(0.0)
    assert calibration_error(parts[0] + no_reliability()).value == pytest.approx(0.25)


def test_a_certain_hypothesis_falls_into_the_last_bin() -> None:
    found = reliability_of(*two_modes(4, 4, 1.0))
    assert found.count.tolist() == [0.0] * 9 + [4.0], "those of probability 0 are not counted"
    assert calibration_error(found).value == 0.0


def test_single_hypotheses_state_nothing() -> None:
    assert not calibration_error(reliability_of(Hypotheses.certain(np.zeros((3, 25, 2))), np.zeros((3, 25, 2)))).valid


def test_probabilities_are_counted_in_tenths() -> None:
    """Four samples of two hypotheses with 0.75 and 0.25; in three of them the more probable is the best."""
    found = reliability_of(*two_modes(4, 3, 0.75))
    assert found.count.tolist() == [0, 0, 4, 0, 0, 0, 0, 4, 0, 0]
    assert found.best.tolist() == [0, 0, 1, 0, 0, 0, 0, 3, 0, 0]
    assert found.probability[[2, 7]] == pytest.approx([1.0, 3.0])
