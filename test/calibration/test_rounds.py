"""Errors with many valleys over a long time and one over a short time: what the lengthening horizon is for."""

from collections.abc import Mapping, Sequence
from itertools import pairwise

import numpy as np
import pytest

from siren_ros.calibration.horizons import WHOLE
from siren_ros.calibration.parameters import Parameter
from siren_ros.calibration.rounds import SAME_PLACE, search_rounds
from siren_ros.calibration.tried import Tried
from siren_ros.numerics.arrays import Floats

UNIT = tuple(Parameter(name, "a share of itself", 0.0, 1.0) for name in ("a", "b"))
TRUTH = {"a": 0.33, "b": 0.71}
TIME_S = np.arange(0.0, 40.0, 0.1)
HORIZONS = (6.0, 9.0, 13.5, 20.0, 30.0, WHOLE)


def swinging(values: Mapping[str, float]) -> Floats:
    """A place that swings: over a long time the error has many valleys, where as many turns fit by chance."""
    return np.asarray(np.sin(1.5 * values["a"] * TIME_S) + np.sin(1.5 * (1.0 + values["b"]) * TIME_S))


class Swing:
    def __init__(self) -> None:
        self.horizons_s: list[float] = []
        noise = np.random.default_rng(7).normal(0.0, 0.05, len(TIME_S))
        self.given = swinging(TRUTH) + noise

    def __call__(self, tries: Sequence[Mapping[str, float]], horizon_s: float) -> list[Floats]:
        self.horizons_s.append(horizon_s)
        seen = horizon_s + 1e-9 > TIME_S
        return [(swinging(values) - self.given)[seen] / np.sqrt(seen.sum()) for values in tries]


def searched(horizons: Sequence[float], seed: int, tries: int = 150) -> tuple[Tried, bool, Swing]:
    swing = Swing()
    tried = Tried(UNIT, swing, lambda *_: None)
    tried.budget = tries
    agreed = search_rounds(tried, horizons, 15, np.random.default_rng(seed))
    return tried, agreed, swing


def off(tried: Tried) -> float:
    return max(abs(value - TRUTH[name]) for name, value in tried.values(tried.best).items())


def test_the_lengthening_horizon_finds_what_the_whole_alone_does_not() -> None:
    lengthened = [searched(HORIZONS, seed) for seed in range(8)]
    assert max(off(tried) for tried, *_ in lengthened) < 0.01
    assert all(tried.best_error_m == pytest.approx(0.05, rel=0.1) for tried, *_ in lengthened)
    alone = [searched((WHOLE,), seed) for seed in range(8)]
    assert sum(off(tried) > 0.1 for tried, *_ in alone) > 4


def test_two_rounds_that_meet_go_on_alike_and_agree() -> None:
    tried, agreed, swing = searched(HORIZONS, 0, 400)
    assert agreed
    changes = [one for one, two in pairwise(swing.horizons_s) if one != two]
    assert changes[: len(HORIZONS) - 1] == list(HORIZONS[:-1]), "the first round goes to the whole"
    assert swing.horizons_s[-1] < WHOLE, "the second one met the first one before"
    assert tried.count < 200
    assert off(tried) < SAME_PLACE


def test_the_end_of_the_tries_is_no_agreement() -> None:
    tried, agreed, _ = searched(HORIZONS, 0, 40)
    assert not agreed
    assert tried.left == 0


def decided(tries: Sequence[Mapping[str, float]], horizon_s: float) -> list[Floats]:
    """From 9 s on a decision falls the other way where ``b`` is small, which nothing tells before."""
    found = []
    for values in tries:
        wrong = 20.0 * (1.0 + values["b"]) if horizon_s > 6.0 and values["b"] < 0.6 else 0.0
        follows = 10.0 * (values["b"] - TRUTH["b"]) if horizon_s > 6.0 and not wrong else 0.0
        found.append(np.array([30.0 * (values["a"] - TRUTH["a"]), follows, wrong, 0.1]))
    return found


@pytest.mark.parametrize("seed", range(5))
def test_a_decision_that_falls_another_way_is_left_by_evolution(seed: int) -> None:
    """Least squares runs to the wrong end: the error falls with ``b`` where the decision is wrong."""
    tried = Tried(UNIT, decided, lambda *_: None)
    tried.budget = 300
    search_rounds(tried, (6.0, WHOLE), 15, np.random.default_rng(seed))
    assert tried.best == pytest.approx([TRUTH["a"], TRUTH["b"]], abs=1e-3)
    assert tried.best_error_m == pytest.approx(0.1, rel=1e-3)


@pytest.mark.parametrize(("left", "goes_on"), [(0.1, False), (0.5, True)])
def test_a_round_that_meets_another_whose_error_grew_looks_for_itself(left: float, goes_on: bool) -> None:
    horizons: list[float] = []

    def growing(tries: Sequence[Mapping[str, float]], horizon_s: float) -> list[Floats]:
        horizons.append(horizon_s)
        rest = 0.1 if horizon_s == 6.0 else left
        return [np.array([30.0 * (values["a"] - 0.3), 30.0 * (values["b"] - 0.7), rest]) for values in tries]

    tried = Tried(UNIT, growing, lambda *_: None)
    tried.budget = 400
    assert search_rounds(tried, (6.0, WHOLE), 15, np.random.default_rng(0))
    assert tried.best == pytest.approx([0.3, 0.7], abs=1e-3)
    assert (horizons[-1] == WHOLE) is goes_on
