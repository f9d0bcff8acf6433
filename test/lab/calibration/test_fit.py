"""Fits and searches.

Errors that have many valleys over a long time and one over a short time are what the lengthening horizon is for.
"""

from collections.abc import Mapping, Sequence
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from siren_ros.base.numerics.arrays import Floats
from siren_ros.errors import InputError
from siren_ros.lab.calibration.fit import (
    LEAST_ERROR_M,
    SAME_PLACE,
    Residuals,
    Spent,
    Tried,
    fit,
    move_shares,
    search_rounds,
    slope,
    spread_shares,
    tries_for,
)
from siren_ros.lab.calibration.problem import FAILED_M, PARAMETERS, WHOLE, parameters_named
from siren_ros.simulation.scenario.driver_parameters import DriverParameter

SHARES = tuple(DriverParameter(name, "a share of itself", None, 0.0, 1.0) for name in ("a", "b"))
SWINGS = {"a": 0.33, "b": 0.71}
TIME_S = np.arange(0.0, 40.0, 0.1)
HORIZONS = (6.0, 9.0, 13.5, 20.0, 30.0, WHOLE)


def swinging(values: Mapping[str, float]) -> Floats:
    """A place that swings: over a long time the error has many valleys, where as many turns fit by chance."""
    return np.asarray(np.sin(1.5 * values["a"] * TIME_S) + np.sin(1.5 * (1.0 + values["b"]) * TIME_S))


class Swing:
    def __init__(self) -> None:
        self.horizons_s: list[float] = []
        noise = np.random.default_rng(7).normal(0.0, 0.05, len(TIME_S))
        self.given = swinging(SWINGS) + noise

    def __call__(self, tries: Sequence[Mapping[str, float]], horizon_s: float) -> list[Floats]:
        self.horizons_s.append(horizon_s)
        seen = horizon_s + 1e-9 > TIME_S
        return [(swinging(values) - self.given)[seen] / np.sqrt(seen.sum()) for values in tries]


def tried_on(residuals: Residuals, budget: int, parameters: tuple[DriverParameter, ...] = SHARES) -> Tried:
    tried = Tried(parameters, residuals, lambda *_: None)
    tried.budget = budget
    return tried


def searched(horizons: Sequence[float], seed: int, tries: int = 150) -> tuple[Tried, bool, Swing]:
    swing = Swing()
    tried = tried_on(swing, tries)
    agreed = search_rounds(tried, horizons, 15, np.random.default_rng(seed))
    return tried, agreed, swing


def distance(tried: Tried) -> float:
    return max(abs(value - SWINGS[name]) for name, value in tried.values(tried.best).items())


def test_the_lengthening_horizon_finds_what_the_whole_alone_does_not() -> None:
    lengthened = [searched(HORIZONS, seed) for seed in range(4)]
    assert max(distance(tried) for tried, *_ in lengthened) < 0.01
    assert all(tried.best_error_m == pytest.approx(0.05, rel=0.1) for tried, *_ in lengthened)
    alone = [searched((WHOLE,), seed) for seed in range(4)]
    assert sum(distance(tried) > 0.1 for tried, *_ in alone) > 2


def test_two_rounds_that_meet_go_on_alike_and_agree() -> None:
    tried, agreed, swing = searched(HORIZONS, 0, 400)
    assert agreed
    changes = [before for before, after in pairwise(swing.horizons_s) if before != after]
    assert changes[: len(HORIZONS) - 1] == list(HORIZONS[:-1]), "the first round goes to the whole"
    assert swing.horizons_s[-1] < WHOLE, "the second one met the first one before"
    assert tried.count < 200
    assert distance(tried) < SAME_PLACE
    tried, agreed, _ = searched(HORIZONS, 0, 40)
    assert (agreed, tried.left) == (False, 0), "the end of the tries is no agreement"


def decided(tries: Sequence[Mapping[str, float]], horizon_s: float) -> list[Floats]:
    """From 9 s on a decision falls the other way where ``b`` is small, not told before; over 3 s another ``a`` fits."""
    residuals = []
    for values in tries:
        wrong = 20.0 * (1.0 + values["b"]) if horizon_s > 6.0 and values["b"] < 0.6 else 0.0
        follows = 10.0 * (values["b"] - SWINGS["b"]) if horizon_s > 6.0 and not wrong else 0.0
        residuals.append(
            np.array([30.0 * (values["a"] - (0.05 if horizon_s < 6.0 else SWINGS["a"])), follows, wrong, 0.1])
        )
    return residuals


@pytest.mark.parametrize("seed", range(2))
def test_a_decision_that_falls_another_way_is_left_by_evolution(seed: int) -> None:
    """Least squares runs to the wrong end: the error falls with ``b`` where the decision is wrong."""
    over_whole: list[float] = []

    def told(tries: Sequence[Mapping[str, float]], horizon_s: float) -> list[Floats]:
        over_whole.extend(values["a"] for values in tries if horizon_s == WHOLE)
        return decided(tries, horizon_s)

    tried = tried_on(told, 300)
    search_rounds(tried, (3.0, 6.0, WHOLE), 15, np.random.default_rng(seed))
    assert min(over_whole) > 0.15, "evolution begins where the horizon before ended, not where the first one did"
    assert tried.best == pytest.approx([SWINGS["a"], SWINGS["b"]], abs=1e-3)
    assert tried.best_error_m == pytest.approx(0.1, rel=1e-3)


@pytest.mark.parametrize(("left", "goes_on"), [(0.1, False), (0.5, True)])
def test_a_round_that_meets_another_whose_error_grew_looks_for_itself(left: float, goes_on: bool) -> None:
    horizons: list[float] = []

    def growing(tries: Sequence[Mapping[str, float]], horizon_s: float) -> list[Floats]:
        horizons.append(horizon_s)
        rest = 0.1 if horizon_s == 6.0 else left
        return [np.array([30.0 * (values["a"] - 0.3), 30.0 * (values["b"] - 0.7), rest]) for values in tries]

    tried = tried_on(growing, 400)
    assert search_rounds(tried, (6.0, WHOLE), 15, np.random.default_rng(0))
    assert tried.best == pytest.approx([0.3, 0.7], abs=1e-3)
    assert (horizons[-1] == WHOLE) is goes_on


NAMES = ("emv.speed_mps", "emv_driver.driving.comfort_accel_mps2", "sumo.tau_s")
NOISE_SHARE = 0.005
TRUTH_FIT = {"emv.speed_mps": 17.0, "emv_driver.driving.comfort_accel_mps2": 1.2, "sumo.tau_s": 2.2}


class Bowl:
    """A smooth error with its minimum at the truth; the parameters are coupled."""

    def __init__(self) -> None:
        self.tries: list[Mapping[str, float]] = []
        self.horizons_s: list[float] = []

    def __call__(self, tries: Sequence[Mapping[str, float]], horizon_s: float) -> list[Floats]:
        self.horizons_s.append(horizon_s)
        self.tries += tries
        return [self.residuals(values) for values in tries]

    @staticmethod
    def residuals(values: Mapping[str, float]) -> Floats:
        known = [PARAMETERS[name] for name in values]
        distance = np.array([each.share_of(values[each.name]) - each.share_of(TRUTH_FIT[each.name]) for each in known])
        return np.array([*distance, distance.sum(), NOISE_SHARE]) * 30.0


@pytest.mark.parametrize("count", [1, 2, 3])
def test_the_minimum_is_found(count: int) -> None:
    bowl, parameters = Bowl(), parameters_named(NAMES[:count])
    fitted = fit(parameters, bowl, 300)
    middle = {each.name: each.at(0.5) for each in parameters}
    assert bowl.tries[0] == middle
    assert fitted.start_error_m == pytest.approx(float(np.linalg.norm(Bowl.residuals(middle))))
    assert all(each.minimum <= values[each.name] <= each.maximum for values in bowl.tries for each in parameters)
    shares = np.array([[each.share_of(values[each.name]) for each in parameters] for values in bowl.tries[1:32]])
    assert shares[0] == pytest.approx(0.5), "the middle, and places that are spread evenly, but for the first, 0"
    assert all(np.bincount((4.0 * of_one + 1e-9).astype(int)).tolist() == [7, 8, 8, 8] for of_one in shares.T)
    for name, value in fitted.values.items():
        reach = PARAMETERS[name].maximum - PARAMETERS[name].minimum
        assert value == pytest.approx(TRUTH_FIT[name], abs=1e-3 * reach)
        assert 0.0 < fitted.spread[name] < 0.01 * reach
    assert fitted.undetermined == ()
    assert fitted.error_m == pytest.approx(float(np.linalg.norm(Bowl.residuals(fitted.values))))
    assert fitted.agreed, "a bowl has one bottom, and two rounds find it"
    assert fitted.evaluations == len(bowl.tries) < 300
    assert list(fitted.history_m) == sorted(fitted.history_m, reverse=True)


def test_rounds_that_end_in_another_valley_are_followed_by_more_until_two_agree() -> None:
    names = NAMES[:2]

    def two_valleys(tries: Sequence[Mapping[str, float]], _: float) -> list[Floats]:
        shares = [np.array([PARAMETERS[name].share_of(values[name]) for name in names]) for values in tries]
        wide = [np.array([1.0, *(3.0 * (share - 0.3))]) for share in shares]
        deep = [np.array([0.1, *(10.0 * (share - (0.85, 0.9)))]) for share in shares]
        return [min(pair, key=np.linalg.norm) for pair in zip(wide, deep, strict=True)]

    few, more = (fit(parameters_named(names), two_valleys, tries) for tries in (400, 1200))
    assert few.error_m == more.error_m == pytest.approx(0.1, rel=0.02)
    assert not few.agreed, "all rounds but one ended in the wide valley"
    assert more.agreed
    assert few.evaluations < more.evaluations < 1200


def test_a_parameter_that_changes_nothing_is_named() -> None:
    def first_alone(tries: Sequence[Mapping[str, float]], _: float) -> list[Floats]:
        return [np.array([values[NAMES[0]] - 17.0, 0.1]) for values in tries]

    fitted = fit(parameters_named(NAMES[:2]), first_alone, 200)
    assert fitted.undetermined == (NAMES[1],)
    assert fitted.spread[NAMES[1]] == pytest.approx(4.0 - 0.8)
    assert fitted.values[NAMES[0]] == pytest.approx(17.0, abs=0.01)


def test_the_same_seed_gives_the_same_search_and_leaves_numpys_generator_alone() -> None:
    np.random.seed(5)  # noqa: NPY002 - the one that must not be touched
    state = np.random.get_state()[1].tolist()  # noqa: NPY002 - the same
    bowls = [Bowl() for _ in range(3)]
    first, same, other = (fit(parameters_named(NAMES), bowls[row], 90, seed=seed) for row, seed in enumerate((3, 3, 4)))
    assert first == same
    assert bowls[0].tries == bowls[1].tries != bowls[2].tries
    assert other.values == pytest.approx(first.values), "the bowl has one bottom"
    assert np.random.get_state()[1].tolist() == state  # noqa: NPY002 - the same


def test_tries_that_fail_are_passed_over_and_failing_alone_is_refused() -> None:
    def half(tries: Sequence[Mapping[str, float]], _: float) -> list[Floats]:
        errors = [FAILED_M if values["sumo.tau_s"] < 1.4 else values["sumo.tau_s"] - 2.2 for values in tries]
        return [np.array([error]) for error in errors]

    assert fit(parameters_named(["sumo.tau_s"]), half, 80).values["sumo.tau_s"] == pytest.approx(2.2, abs=0.05)
    with pytest.raises(InputError, match="every try failed"):
        fit(parameters_named(["sumo.tau_s"]), lambda tries, _: [np.array([FAILED_M])] * len(tries), 20)
    with pytest.raises(InputError, match="more than 15"):
        fit(parameters_named(NAMES), Bowl(), 15)


SPEED_AND_HEADWAY = parameters_named(["emv.speed_mps", "sumo.tau_s"])


def off(tries: Sequence[Mapping[str, float]], horizon_s: float) -> list[Floats]:
    wrong = 0.0 if horizon_s == WHOLE else 2.0
    return [np.array([values["emv.speed_mps"] - 11.0 - wrong, values["sumo.tau_s"] - 1.0]) for values in tries]


def test_errors_over_one_horizon_are_not_held_against_those_over_another() -> None:
    reports: list[tuple[int, float, float]] = []
    tried = Tried(SPEED_AND_HEADWAY, off, lambda *report: reports.append(report))
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
    tried = tried_on(off, 0, SPEED_AND_HEADWAY)
    with pytest.raises(Spent):
        tried([[0.5, 0.5]])
    tried.budget = 4
    tried([[0.5, 0.5], [0.25, 0.5], [0.7, 0.5]])  # 14 m/s, 11 m/s and 16.4 m/s
    assert tried.left == 1
    assert len(tried([[0.1, 0.5], [0.2, 0.5], [0.3, 0.5]])) == 3
    assert (tried.left, tried.count) == (0, 6)
    assert (tried.best.tolist(), tried.history_m) == ([0.25, 0.5], pytest.approx([0.5, 0.5]))
    with pytest.raises(Spent):
        tried([[0.5, 0.5]])


def test_parameters_move_until_the_error_has_grown_by_a_tenth() -> None:
    (move,) = move_shares(np.array([[20.0], [0.0]]), 0.4)
    assert np.hypot(0.4, 20.0 * move) == pytest.approx(1.1 * 0.4, rel=1e-3)
    alone = move_shares(np.diag([10.0, 10.0]), 0.2)
    alike = move_shares(np.array([[10.0, 9.0], [0.0, np.sqrt(19.0)]]), 0.2)  # slopes of equal length, cosine 0.9
    assert alike == pytest.approx(alone / np.sqrt(1.0 - 0.9**2), rel=5e-3)
    assert move_shares(np.diag([50.0, 0.0]), 0.2)[1] == pytest.approx(1.0), "without effect, over its whole range"
    slopes = np.diag([3.0, 4.0])
    assert move_shares(slopes, 0.0).tolist() == move_shares(slopes, LEAST_ERROR_M).tolist()


@given(st.floats(0.0, 1.0), st.floats(0.0, 1.0))
def test_the_slopes_are_taken_within_the_ranges(first: float, second: float) -> None:
    asked: list[Mapping[str, float]] = []

    def line(tries: Sequence[Mapping[str, float]], _: float) -> list[Floats]:
        asked.extend(tries)
        shares = [[parameter.share_of(values[parameter.name]) for parameter in SPEED_AND_HEADWAY] for values in tries]
        return [np.array([7.0 * share[0], 11.0 * share[1]]) for share in shares]

    tried, place = tried_on(line, 1, SPEED_AND_HEADWAY), np.array([first, second])
    moves = spread_shares(tried, place, 0.3)
    assert moves == pytest.approx(move_shares(np.diag([7.0, 11.0]), 0.3))
    assert len(asked) == tries_for(2) == 4
    tried.budget = 5
    assert slope(tried, place, place * [7.0, 11.0]) == pytest.approx(np.diag([7.0, 11.0]))
    for parameter in SPEED_AND_HEADWAY:
        assert all(parameter.minimum - 1e-9 <= values[parameter.name] <= parameter.maximum + 1e-9 for values in asked)
