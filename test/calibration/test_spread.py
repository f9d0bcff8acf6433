"""How far a parameter can move, held against slopes whose ellipsoid is known."""

from collections.abc import Mapping, Sequence

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from siren_ros.calibration.parameters import parameters_named
from siren_ros.calibration.spread import LEAST_ERROR_M, move_shares, spread_shares, tries_for
from siren_ros.calibration.tried import Tried
from siren_ros.numerics.arrays import Floats

GROWN = 1.1**2 - 1.0
PARAMETERS = parameters_named(["controller.target_speed_mps", "sumo.tau_s"])


def test_a_parameter_alone_moves_until_the_error_has_grown_by_a_tenth() -> None:
    error, slope = 0.4, 20.0
    (move,) = move_shares(np.array([[slope], [0.0]]), error)
    assert np.hypot(error, slope * move) == pytest.approx(1.1 * error, rel=1e-3)


def test_parameters_that_change_the_way_alike_move_farther_together() -> None:
    alone = move_shares(np.diag([10.0, 10.0]), 0.2)
    alike = move_shares(np.array([[10.0, 9.0], [0.0, np.sqrt(19.0)]]), 0.2)  # slopes of equal length, cosine 0.9
    assert alike == pytest.approx(alone / np.sqrt(1.0 - 0.9**2), rel=5e-3)


def test_a_parameter_without_effect_has_its_whole_range() -> None:
    moves = move_shares(np.array([[50.0, 0.0], [0.0, 0.0]]), 0.2)
    assert moves[0] < 0.01
    assert moves[1] == pytest.approx(1.0)


def test_an_error_of_nothing_counts_as_the_least_that_a_tracker_has() -> None:
    slopes = np.diag([3.0, 4.0])
    assert move_shares(slopes, 0.0).tolist() == move_shares(slopes, LEAST_ERROR_M).tolist()


@given(st.floats(0.0, 1.0), st.floats(0.0, 1.0))
def test_the_slopes_are_taken_within_the_ranges(first: float, second: float) -> None:
    asked: list[Mapping[str, float]] = []

    def line(tries: Sequence[Mapping[str, float]], _: float) -> list[Floats]:
        asked.extend(tries)
        shares = [[one.share_of(values[one.name]) for one in PARAMETERS] for values in tries]
        return [np.array([7.0 * share[0], 11.0 * share[1]]) for share in shares]

    tried = Tried(PARAMETERS, line, lambda *_: None)
    tried.budget = 1
    found = spread_shares(tried, np.array([first, second]), 0.3)
    assert found == pytest.approx(move_shares(np.diag([7.0, 11.0]), 0.3))
    assert len(asked) == tries_for(2) == 4
    for one in PARAMETERS:
        assert all(one.low - 1e-9 <= values[one.name] <= one.high + 1e-9 for values in asked)
