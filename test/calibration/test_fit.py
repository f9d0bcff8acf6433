"""The search, held against errors whose minimum is known."""

from collections.abc import Mapping, Sequence

import numpy as np
import pytest

from siren_ros.calibration.fit import fit
from siren_ros.calibration.parameters import PARAMETERS, parameters_named
from siren_ros.calibration.simulate import FAILED_M
from siren_ros.errors import InputError

NAMES = ("controller.target_speed_mps", "controller.accel_mps2", "sumo.tau_s")
TRUTH = {"controller.target_speed_mps": 17.0, "controller.accel_mps2": 1.2, "sumo.tau_s": 2.2}


class Bowl:
    """A smooth error with its minimum at the truth; the parameters are coupled."""

    def __init__(self) -> None:
        self.tries: list[Mapping[str, float]] = []

    def __call__(self, tries: Sequence[Mapping[str, float]]) -> list[float]:
        self.tries += tries
        return [self.error(values) for values in tries]

    @staticmethod
    def error(values: Mapping[str, float]) -> float:
        off = np.array(
            [
                PARAMETERS[name].share_of(value) - PARAMETERS[name].share_of(TRUTH[name])
                for name, value in values.items()
            ]
        )
        return float(np.sqrt(np.sum(off**2) + off.sum() ** 2)) * 30.0


@pytest.mark.parametrize("count", [1, 2, 3])
def test_the_minimum_is_found(count: int) -> None:
    bowl = Bowl()
    found = fit(parameters_named(NAMES[:count]), bowl, 250)
    for name, value in found.values.items():
        reach = PARAMETERS[name].high - PARAMETERS[name].low
        assert value == pytest.approx(TRUTH[name], abs=0.01 * reach)
        assert 0.0 < found.spread[name] < 0.1 * reach
    assert found.error_m == pytest.approx(Bowl.error(found.values))
    assert found.error_m < found.start_error_m
    assert found.evaluations == len(bowl.tries) < 250 + 14
    assert list(found.history_m) == sorted(found.history_m, reverse=True)


def test_a_search_that_ends_in_a_valley_begins_again_elsewhere() -> None:
    names = NAMES[:2]

    def two_valleys(tries: Sequence[Mapping[str, float]]) -> list[float]:
        shares = [np.array([PARAMETERS[name].share_of(values[name]) for name in names]) for values in tries]
        return [
            float(min(1.0 + 3.0 * np.abs(share - 0.3).sum(), 10.0 * np.abs(share - (0.85, 0.9)).sum()))
            for share in shares
        ]

    once, again = (fit(parameters_named(names), two_valleys, tries) for tries in (100, 600))
    assert once.error_m == pytest.approx(1.0, abs=0.1)
    assert again.error_m < 0.2
    assert min(again.spread.values()) > 0.0


def test_every_try_is_within_the_ranges() -> None:
    bowl = Bowl()
    fit(parameters_named(NAMES), bowl, 60)
    for values in bowl.tries:
        for name, value in values.items():
            assert PARAMETERS[name].low <= value <= PARAMETERS[name].high


def test_the_same_seed_gives_the_same_search_and_leaves_numpys_generator_alone() -> None:
    np.random.seed(5)  # noqa: NPY002 - the one that must not be touched
    state = np.random.get_state()[1].tolist()  # noqa: NPY002 - the same
    one, other = (fit(parameters_named(NAMES), Bowl(), 40, seed=3) for _ in range(2))
    assert one == other
    assert fit(parameters_named(NAMES), Bowl(), 40, seed=4) != one
    assert np.random.get_state()[1].tolist() == state  # noqa: NPY002 - the same


def test_the_search_begins_where_it_is_told() -> None:
    bowl = Bowl()
    fit(parameters_named(NAMES[:2]), bowl, 20, start={NAMES[0]: 9.0})
    assert bowl.tries[0] == pytest.approx({NAMES[0]: 9.0, NAMES[1]: 2.4})
    with pytest.raises(InputError, match="8 to 20"):
        fit(parameters_named(NAMES[:1]), bowl, 20, start={NAMES[0]: 25.0})


def test_tries_that_fail_are_passed_over_and_failing_alone_is_refused() -> None:
    def half(tries: Sequence[Mapping[str, float]]) -> list[float]:
        return [FAILED_M if values["sumo.tau_s"] < 1.4 else abs(values["sumo.tau_s"] - 2.2) for values in tries]

    assert fit(parameters_named(["sumo.tau_s"]), half, 80).values["sumo.tau_s"] == pytest.approx(2.2, abs=0.05)
    with pytest.raises(InputError, match="every try failed"):
        fit(parameters_named(["sumo.tau_s"]), lambda tries: [FAILED_M] * len(tries), 20)


def test_less_than_a_generation_is_refused() -> None:
    with pytest.raises(InputError, match="one generation"):
        fit(parameters_named(NAMES), Bowl(), 3)
