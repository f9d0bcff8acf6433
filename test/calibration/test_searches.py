"""Each search alone, on errors whose minimum is known."""

from collections.abc import Mapping, Sequence

import numpy as np
import pytest

from siren_ros.calibration.horizons import WHOLE
from siren_ros.calibration.parameters import Parameter
from siren_ros.calibration.searches import NEAR_SHARE, descend, evolve, slope, spread_out
from siren_ros.calibration.tried import Spent, Tried
from siren_ros.numerics.arrays import Floats

UNIT = tuple(Parameter(name, "a share of itself", 0.0, 1.0) for name in ("a", "b", "c"))
TRUTH = np.array([0.62, 0.31, 0.8])
NOISE_M = 0.14


def valley(tries: Sequence[Mapping[str, float]], _: float = WHOLE) -> list[Floats]:
    """Noise that no parameter explains; the first parameter nearly makes good what the second one changes."""
    found = []
    for values in tries:
        a, b, c = np.array([values["a"], values["b"], values["c"]]) - TRUTH
        found.append(np.array([50.0 * a + 3.0 * b, 3.0 * b * (1.0 + b), 10.0 * c + 20.0 * a, NOISE_M]))
    return found


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
    errors = [float(np.linalg.norm(one)) for one in valley(seen)]
    assert dict(zip("abc", best, strict=True)) == seen[int(np.argmin(errors))]
    for name in "abc":
        quarters = [int(4 * values[name]) for values in seen]
        assert [quarters.count(one) for one in range(4)] == [3, 4, 4, 4], "the first of Sobol's, 0, is left out"


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
        found = slope(tried_with(3, line), place, here)
        assert found == pytest.approx(np.array([[2.0, -1.0, 0.0], [0.0, 0.0, 5.0]]))


def test_a_search_ends_where_the_tries_are_spent() -> None:
    with pytest.raises(Spent):
        evolve(tried_with(20), np.full(3, 0.5), np.random.default_rng(4))
    with pytest.raises(Spent):
        descend(tried_with(3), np.full(3, 0.5))
