import numpy as np
import pytest

from siren_ros.errors import InputError
from siren_ros.scenario.templates import load_template
from siren_ros.studies.draws import DrawPlan, Method, draws_of

S2 = load_template("S2")
RANGES = {"emv.speed_mps": (12.0, 16.0), "demand.background_vehicles": (16.0, 19.0)}


def test_a_grid_is_every_combination() -> None:
    plan = DrawPlan(
        Method.GRID, values={"emv.speed_mps": (12.0, 14.0), "demand.background_vehicles": (16.0, 20.0, 24.0)}
    )
    found = draws_of(plan, S2)
    assert len(found) == len({tuple(sorted(values.items())) for values in found}) == 6
    assert found[0] == {"demand.background_vehicles": 16.0, "emv.speed_mps": 12.0}


def test_a_latin_hypercube_has_one_draw_in_each_slice_of_each_parameter() -> None:
    plan = DrawPlan(Method.LATIN_HYPERCUBE, samples=8, ranges=RANGES)
    found = draws_of(plan, S2)
    slices = np.floor([(values["emv.speed_mps"] - 12.0) / 0.5 for values in found])
    assert sorted(slices) == list(range(8))
    counts = [values["demand.background_vehicles"] for values in found]
    assert sorted(counts) == [16.0, 16.0, 17.0, 17.0, 18.0, 18.0, 19.0, 19.0]


@pytest.mark.parametrize("method", [Method.RANDOM, Method.LATIN_HYPERCUBE])
def test_draws_depend_on_seed_and_template_alone(method: Method) -> None:
    plan = DrawPlan(method, samples=5, seed=3)
    assert draws_of(plan, S2) == draws_of(plan, S2)
    assert draws_of(plan, S2) != draws_of(DrawPlan(method, samples=5, seed=4), S2)
    assert set(draws_of(plan, S2)[0]) == set(S2.ranges) - {"duration_s"}


def test_random_draws_stay_the_same_when_more_are_asked_for() -> None:
    few, many = (draws_of(DrawPlan(Method.RANDOM, samples=count, ranges=RANGES), S2) for count in (3, 9))
    assert many[:3] == few


@pytest.mark.parametrize(
    "plan",
    [
        DrawPlan(Method.GRID, values={"emv.speed_mps": (99.0,)}),
        DrawPlan(Method.GRID, values={"emv.colour": (1.0,)}),
        DrawPlan(Method.RANDOM, samples=3, ranges={"emv.colour": (0.0, 1.0)}),
        DrawPlan(Method.RANDOM, samples=3, ranges={"emv.speed_mps": (14.0, 99.0)}),
        DrawPlan(Method.LATIN_HYPERCUBE, samples=0),
    ],
)
def test_what_the_template_does_not_allow_is_refused(plan: DrawPlan) -> None:
    with pytest.raises(InputError):
        draws_of(plan, S2)


def test_values_go_to_their_own_parameters() -> None:
    """Each one lies in its own range, and whole numbers are whole and reach both ends."""
    ranges = {"emv.speed_mps": (12.0, 12.5), "demand.background_vehicles": (16.0, 18.0)}
    found = draws_of(DrawPlan(Method.RANDOM, samples=60, ranges=ranges), S2)
    speeds = [values["emv.speed_mps"] for values in found]
    counts = [values["demand.background_vehicles"] for values in found]
    assert 12.0 <= min(speeds) < 12.05
    assert 12.45 < max(speeds) <= 12.5
    assert set(counts) == {16.0, 17.0, 18.0}
    assert np.corrcoef(speeds, counts)[0, 1] < 0.5, "each has numbers of its own"


def test_a_range_of_one_value_is_that_value() -> None:
    found = draws_of(DrawPlan(Method.RANDOM, samples=3, ranges={"emv.speed_mps": (13.0, 13.0)}), S2)
    assert found == ({"emv.speed_mps": 13.0},) * 3
