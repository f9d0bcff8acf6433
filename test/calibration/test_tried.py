"""What a search remembers of its tries."""

from collections.abc import Mapping, Sequence

import numpy as np
import pytest

from siren_ros.calibration.parameters import parameters_named
from siren_ros.calibration.tried import Spent, Tried
from siren_ros.numerics.arrays import Floats

PARAMETERS = parameters_named(["controller.target_speed_mps", "sumo.tau_s"])


def off(tries: Sequence[Mapping[str, float]]) -> list[Floats]:
    return [np.array([values["controller.target_speed_mps"] - 11.0, values["sumo.tau_s"] - 1.0]) for values in tries]


def test_the_best_try_is_kept_with_its_error() -> None:
    told: list[tuple[int, float]] = []
    tried = Tried(PARAMETERS, off, lambda count, error: told.append((count, error)))
    tried.budget = 10
    tried([[0.5, 0.5], [0.25, 0.5]])  # 14 m/s and 11 m/s, both 1.5 s
    assert tried.best.tolist() == [0.25, 0.5]
    assert tried.best_error_m == pytest.approx(0.5)
    tried([[1.0, 0.25]])
    assert tried.best.tolist() == [0.25, 0.5], "a worse try changes nothing"
    assert tried.history_m == pytest.approx([0.5, 0.5])
    assert told == [(2, pytest.approx(0.5)), (3, pytest.approx(0.5))]


def test_a_group_that_was_begun_is_finished_and_then_the_tries_are_spent() -> None:
    tried = Tried(PARAMETERS, off, lambda _, __: None)
    with pytest.raises(Spent):
        tried([[0.5, 0.5]])
    tried.budget = 2
    tried([[0.5, 0.5]])
    assert tried.left == 1
    assert len(tried([[0.1, 0.5], [0.2, 0.5], [0.3, 0.5]])) == 3
    assert (tried.left, tried.count) == (0, 4)
    with pytest.raises(Spent):
        tried([[0.5, 0.5]])


def test_shares_beyond_the_parameters_say_nothing() -> None:
    tried = Tried(PARAMETERS[:1], lambda tries: [np.array([len(tries[0])])], lambda _, __: None)
    tried.budget = 1
    assert tried([[0.5, 0.9]])[0].tolist() == [1]
    assert tried.best.tolist() == [0.5]
