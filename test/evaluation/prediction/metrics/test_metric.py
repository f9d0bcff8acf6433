import numpy as np
import pytest

from siren_ros.evaluation.prediction.metrics.metric import Metric

PLAIN = Metric("x", "x", lambda *_: np.zeros(0))


def test_samples_without_a_statement_do_not_count() -> None:
    value = PLAIN.value(np.array([1.0, np.nan, 3.0]))
    assert (value.value, value.samples, value.valid) == (2.0, 2, True)
    assert not PLAIN.value(np.full(3, np.nan)).valid


def test_the_root_is_that_of_the_mean() -> None:
    rooted = Metric("x", "x", PLAIN.of_samples, np.sqrt)
    assert rooted.value(np.array([1.0, 7.0])).value == pytest.approx(2.0)
