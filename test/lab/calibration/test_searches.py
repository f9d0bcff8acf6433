"""What a search remembers of its tries."""

from collections.abc import Mapping, Sequence

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from siren_ros.base.numerics.arrays import Floats
from siren_ros.lab.calibration.parameters import parameters_named
from siren_ros.lab.calibration.searches import (
    LEAST_ERROR_M,
    NEAR_SHARE,
    Spent,
    Tried,
    descend,
    evolve,
    move_shares,
    slope,
    spread_out,
    spread_shares,
    tries_for,
)
from siren_ros.lab.calibration.targets import WHOLE
from siren_ros.simulation.scenario.driver_parameters import DriverParameter

PARAMETERS = parameters_named(["emv.speed_mps", "sumo.tau_s"])


def off(tries: Sequence[Mapping[str, float]], horizon_s: float) -> list[Floats]:
    wrong = 0.0 if horizon_s == WHOLE else 2.0
    return [np.array([values["emv.speed_mps"] - 11.0 - wrong, values["sumo.tau_s"] - 1.0]) for values in tries]


def test_the_best_try_is_kept_with_its_error() -> None:
    reports: list[tuple[int, float, float]] = []
    tried = Tried(PARAMETERS, off, lambda *report: reports.append(report))
    tried.budget = 10
    tried([[0.5, 0.5], [0.25, 0.5]])  # 14 m/s and 11 m/s, both 1.5 s
    assert tried.best.tolist() == [0.25, 0.5]
    assert tried.best_error_m == pytest.approx(0.5)
    tried([[1.0, 0.25]])
    assert tried.best.tolist() == [0.25, 0.5], "a worse try changes nothing"
    assert tried.history_m == pytest.approx([0.5, 0.5])
    assert reports == [(2, WHOLE, pytest.approx(0.5)), (3, WHOLE, pytest.approx(0.5))]


def test_errors_over_one_horizon_are_not_held_against_those_over_another() -> None:
    reports: list[tuple[int, float, float]] = []
    tried = Tried(PARAMETERS, off, lambda *report: reports.append(report))
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
    assert [horizon for _, horizon, _ in reports] == [6.0, 9.0, 6.0, WHOLE]
    assert reports[2][2] == pytest.approx(3.8), "the least over these 6 s"


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


UNIT = tuple(DriverParameter(name, "a share of itself", None, 0.0, 1.0) for name in ("a", "b", "c"))
TRUTH = np.array([0.62, 0.31, 0.8])
NOISE_M = 0.14


def valley(tries: Sequence[Mapping[str, float]], _: float = WHOLE) -> list[Floats]:
    """Noise that no parameter explains; the first parameter nearly makes good what the second one changes."""
    residuals = []
    for values in tries:
        a, b, c = np.array([values["a"], values["b"], values["c"]]) - TRUTH
        residuals.append(np.array([50.0 * a + 3.0 * b, 3.0 * b * (1.0 + b), 10.0 * c + 20.0 * a, NOISE_M]))
    return residuals


def tried_with(budget: int, residuals: object = valley) -> Tried:
    tried = Tried(UNIT, residuals, lambda *_: None)  # type: ignore[arg-type] # functions of the tests
    tried.budget = budget
    return tried


def test_the_first_places_are_the_middle_and_an_even_spread() -> None:
    seen: list[Mapping[str, float]] = []

    def keep(tries: Sequence[Mapping[str, float]], _: float) -> list[Floats]:
        seen.extend(tries)
        return valley(tries)

    best = spread_out(tried_with(15, keep), 3, 15)
    assert seen[0] == {"a": 0.5, "b": 0.5, "c": 0.5}
    errors = [float(np.linalg.norm(apart)) for apart in valley(seen)]
    assert dict(zip("abc", best, strict=True)) == seen[int(np.argmin(errors))]
    for name in "abc":
        quarters = [int(4 * values[name]) for values in seen]
        assert [quarters.count(quarter) for quarter in range(4)] == [3, 4, 4, 4], "the first of Sobol's, 0, is left out"


def test_the_bottom_of_a_valley_is_found_from_its_side() -> None:
    tried = tried_with(100)
    bottom = descend(tried, np.array([0.6, 0.9, 0.5]))
    assert tried.best == pytest.approx(TRUTH, abs=2e-3)
    assert bottom.error_m == tried.best_error_m == pytest.approx(NOISE_M, rel=1e-3)
    assert tried.count < 60


def test_an_evolution_comes_near() -> None:
    tried = tried_with(400)
    best = evolve(tried, np.full(3, 0.5), np.random.default_rng(4))
    assert best == pytest.approx(TRUTH, abs=10.0 * NEAR_SHARE)
    assert float(np.linalg.norm(valley([dict(zip("abc", best, strict=True))])[0])) < 3.0


def test_the_slope_is_that_of_a_line_within_the_ranges_at_their_ends_too() -> None:
    def line(tries: Sequence[Mapping[str, float]], _: float = WHOLE) -> list[Floats]:
        assert all(0.0 <= value <= 1.0 for values in tries for value in values.values())
        return [np.array([2.0 * v["a"] - v["b"], 5.0 * v["c"]]) for v in tries]

    for place in (np.array([0.0, 1.0, 0.5]), np.array([1.0, 0.0, 0.3])):
        (here,) = line([dict(zip("abc", place, strict=True))])
        slopes = slope(tried_with(3, line), place, here)
        assert slopes == pytest.approx(np.array([[2.0, -1.0, 0.0], [0.0, 0.0, 5.0]]))


def test_a_search_ends_where_the_tries_are_spent() -> None:
    with pytest.raises(Spent):
        evolve(tried_with(20), np.full(3, 0.5), np.random.default_rng(4))
    with pytest.raises(Spent):
        descend(tried_with(3), np.full(3, 0.5))


GROWN = 1.1**2 - 1.0


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
        shares = [[parameter.share_of(values[parameter.name]) for parameter in PARAMETERS] for values in tries]
        return [np.array([7.0 * share[0], 11.0 * share[1]]) for share in shares]

    tried = Tried(PARAMETERS, line, lambda *_: None)
    tried.budget = 1
    moves = spread_shares(tried, np.array([first, second]), 0.3)
    assert moves == pytest.approx(move_shares(np.diag([7.0, 11.0]), 0.3))
    assert len(asked) == tries_for(2) == 4
    for parameter in PARAMETERS:
        assert all(parameter.minimum - 1e-9 <= values[parameter.name] <= parameter.maximum + 1e-9 for values in asked)
