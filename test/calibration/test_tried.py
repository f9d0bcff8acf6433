"""What a search remembers of its tries."""

from collections.abc import Mapping, Sequence

import numpy as np
import pytest

from siren_ros.calibration.horizons import WHOLE
from siren_ros.calibration.parameters import parameters_named
from siren_ros.calibration.tried import Spent, Tried
from siren_ros.numerics.arrays import Floats

PARAMETERS = parameters_named(["controller.target_speed_mps", "sumo.tau_s"])


def off(tries: Sequence[Mapping[str, float]], horizon_s: float) -> list[Floats]:
    wrong = 0.0 if horizon_s == WHOLE else 2.0
    return [
        np.array([values["controller.target_speed_mps"] - 11.0 - wrong, values["sumo.tau_s"] - 1.0]) for values in tries
    ]


def test_the_best_try_is_kept_with_its_error() -> None:
    told: list[tuple[int, float, float]] = []
    tried = Tried(PARAMETERS, off, lambda *found: told.append(found))
    tried.budget = 10
    tried([[0.5, 0.5], [0.25, 0.5]])  # 14 m/s and 11 m/s, both 1.5 s
    assert tried.best.tolist() == [0.25, 0.5]
    assert tried.best_error_m == pytest.approx(0.5)
    tried([[1.0, 0.25]])
    assert tried.best.tolist() == [0.25, 0.5], "a worse try changes nothing"
    assert tried.history_m == pytest.approx([0.5, 0.5])
    assert told == [(2, WHOLE, pytest.approx(0.5)), (3, WHOLE, pytest.approx(0.5))]


def test_errors_over_one_horizon_are_not_held_against_those_over_another() -> None:
    told: list[tuple[int, float, float]] = []
    tried = Tried(PARAMETERS, off, lambda *found: told.append(found))
    tried.budget = 10
    assert tried.best.tolist() == tried.farthest.tolist() == [0.5, 0.5], "the middle, before the first try"
    for tried.horizon_s, speed in ((6.0, 0.0), (9.0, 5.0 / 12.0), (6.0, 0.1)):
        tried([[speed, 0.25]])
    assert tried.best_error_m == np.inf
    assert tried.farthest.tolist() == [5.0 / 12.0, 0.25], "of the 9 s"
    tried.horizon_s = WHOLE
    tried([[0.5, 0.25]])
    assert tried.best_error_m == pytest.approx(3.0), "less over 9 s says nothing about the whole"
    assert tried.best.tolist() == [0.5, 0.25]
    assert tried.farthest.tolist() == [5.0 / 12.0, 0.25]
    assert tried.history_m == pytest.approx([3.0])
    assert [horizon for _, horizon, _ in told] == [6.0, 9.0, 6.0, WHOLE]
    assert told[2][2] == pytest.approx(3.8), "the least over these 6 s"


def test_a_group_that_was_begun_is_finished_and_then_the_tries_are_spent() -> None:
    tried = Tried(PARAMETERS, off, lambda *_: None)
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
    tried = Tried(PARAMETERS[:1], lambda tries, _: [np.array([len(tries[0])])], lambda *_: None)
    tried.budget = 1
    assert tried([[0.5, 0.9]])[0].tolist() == [1]
    assert tried.best.tolist() == [0.5]
