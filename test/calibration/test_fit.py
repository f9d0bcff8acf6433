"""The search, held against errors whose minimum is known."""

from collections.abc import Mapping, Sequence

import numpy as np
import pytest

from siren_ros.calibration.fit import fit
from siren_ros.calibration.parameters import PARAMETERS, parameters_named
from siren_ros.calibration.simulate import FAILED_M
from siren_ros.errors import InputError
from siren_ros.numerics.arrays import Floats

NAMES = ("controller.target_speed_mps", "controller.accel_mps2", "sumo.tau_s")
NOISE_SHARE = 0.005
TRUTH = {"controller.target_speed_mps": 17.0, "controller.accel_mps2": 1.2, "sumo.tau_s": 2.2}


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
        off = np.array(
            [
                PARAMETERS[name].share_of(value) - PARAMETERS[name].share_of(TRUTH[name])
                for name, value in values.items()
            ]
        )
        return np.array([*off, off.sum(), NOISE_SHARE]) * 30.0


@pytest.mark.parametrize("count", [1, 2, 3])
def test_the_minimum_is_found(count: int) -> None:
    bowl = Bowl()
    found = fit(parameters_named(NAMES[:count]), bowl, 300)
    for name, value in found.values.items():
        reach = PARAMETERS[name].high - PARAMETERS[name].low
        assert value == pytest.approx(TRUTH[name], abs=1e-3 * reach)
        assert 0.0 < found.spread[name] < 0.01 * reach
    assert found.undetermined == ()
    assert found.error_m == pytest.approx(float(np.linalg.norm(Bowl.residuals(found.values))))
    assert found.error_m < found.start_error_m
    assert found.agreed, "a bowl has one bottom, and two rounds find it"
    assert found.evaluations == len(bowl.tries) < 300
    assert list(found.history_m) == sorted(found.history_m, reverse=True)


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

    found = fit(parameters_named(NAMES[:2]), first_alone, 200)
    assert found.undetermined == (NAMES[1],)
    assert found.spread[NAMES[1]] == pytest.approx(4.0 - 0.8)
    assert found.values[NAMES[0]] == pytest.approx(17.0, abs=0.01)


def test_every_try_is_within_the_ranges() -> None:
    bowl = Bowl()
    fit(parameters_named(NAMES), bowl, 60)
    for values in bowl.tries:
        for name, value in values.items():
            assert PARAMETERS[name].low <= value <= PARAMETERS[name].high


def test_the_same_seed_gives_the_same_search_and_leaves_numpys_generator_alone() -> None:
    np.random.seed(5)  # noqa: NPY002 - the one that must not be touched
    state = np.random.get_state()[1].tolist()  # noqa: NPY002 - the same
    bowls = [Bowl() for _ in range(3)]
    one, same, other = (fit(parameters_named(NAMES), bowls[row], 90, seed=seed) for row, seed in enumerate((3, 3, 4)))
    assert one == same
    assert bowls[0].tries == bowls[1].tries != bowls[2].tries
    assert other.values == pytest.approx(one.values), "the bowl has one bottom"
    assert np.random.get_state()[1].tolist() == state  # noqa: NPY002 - the same


def test_the_search_begins_in_the_middle() -> None:
    bowl = Bowl()
    found = fit(parameters_named(NAMES[:2]), bowl, 20)
    middle = {NAMES[0]: 14.0, NAMES[1]: 2.4}
    assert bowl.tries[0] == pytest.approx(middle)
    assert found.start_error_m == pytest.approx(float(np.linalg.norm(Bowl.residuals(middle))))


def test_tries_that_fail_are_passed_over_and_failing_alone_is_refused() -> None:
    def half(tries: Sequence[Mapping[str, float]], _: float) -> list[Floats]:
        errors = [FAILED_M if values["sumo.tau_s"] < 1.4 else values["sumo.tau_s"] - 2.2 for values in tries]
        return [np.array([error]) for error in errors]

    assert fit(parameters_named(["sumo.tau_s"]), half, 80).values["sumo.tau_s"] == pytest.approx(2.2, abs=0.05)
    with pytest.raises(InputError, match="every try failed"):
        fit(parameters_named(["sumo.tau_s"]), lambda tries, _: [np.array([FAILED_M])] * len(tries), 20)


def test_less_than_a_generation_and_the_spread_is_refused() -> None:
    with pytest.raises(InputError, match="more than 15"):
        fit(parameters_named(NAMES), Bowl(), 15)
