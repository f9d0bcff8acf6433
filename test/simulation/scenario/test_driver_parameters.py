"""Parameters of drivers: names, ranges, and who goes first."""

import math
from dataclasses import replace
from itertools import pairwise
from typing import Any

import pytest

from siren_ros.errors import InputError
from siren_ros.simulation.scenario.driver_parameters import DRIVER_PARAMETERS, DriverParameters, driver_parameters
from siren_ros.simulation.scenario.paper import PAPER_SPEEDS

OWN_SPEEDS: tuple[str, ...] = ("emv_route_follow_mps", "emv_lane_change_mps", "emv_copy_sumo_mps", "emv_gap_escape_mps")
OWN_SPEEDS += ("civilian_yield_lane_change_mps", "civilian_pull_over_mps")
HEADWAY, GAIN = "civilian_driver.driving.headway_s", "emv_driver.pass_gain_m"


def value_of(parameters: Any, name: str) -> Any:
    for part in name.split("."):
        parameters = getattr(parameters, part)
    return parameters


@pytest.mark.parametrize("name", DRIVER_PARAMETERS)
def test_each_parameter_is_set_by_its_name_within_its_range_and_changes_nothing_else(name: str) -> None:
    known = DRIVER_PARAMETERS[name]
    assert known.minimum < known.maximum
    assert known.meaning
    assert known.default is None or known.minimum <= known.default <= known.maximum
    for value in (known.minimum - 1e-6, known.maximum + 1e-6, float("nan")):
        with pytest.raises(InputError, match=name):
            DriverParameters().with_values({name: value})
    value = 0.5 * ((known.maximum if known.default is None else known.default) + known.minimum)
    if known.default == known.minimum:
        value = known.maximum
    changed = DriverParameters().with_values({name: value})
    assert value_of(changed, name) == value
    assert changed.with_values({} if known.default is None else {name: known.default}) in {changed, DriverParameters()}


def test_unknown_names_are_refused_with_the_known_ones() -> None:
    with pytest.raises(InputError) as refused:
        DriverParameters().with_values({"emv_driver.mood": 1.0})
    assert HEADWAY in refused.value.allowed


def test_values_go_before_the_template_and_this_before_the_preset() -> None:
    parameters = driver_parameters({HEADWAY: 1.1, GAIN: 30.0}, {HEADWAY: 1.4, "emv.speed_mps": 12.0})
    assert (value_of(parameters, HEADWAY), value_of(parameters, GAIN)) == (1.4, 30.0)


MARGINS = {
    "emv_driver.corridor": ("narrow_gap_m", "tight_gap_m", "clearance_m"),
    "emv_driver.gap_escape": ("wide_gap_m", "narrow_gap_m", "tight_gap_m"),
    "civilian_driver.manoeuvring": ("narrow_gap_m", "clearance_m"),
}


@pytest.mark.parametrize(("owner", "names"), MARGINS.items())
def test_margins_fall_each_with_its_speed(owner: str, names: tuple[str, ...]) -> None:
    """Values of one owner may change together where each alone would not fit the others."""
    gaps = dict(zip(names, (0.5, 0.4, 0.1)[-len(names) :], strict=True))
    paces = {"narrow_mps": 3.0, "tight_mps": 1.0} if len(names) > 2 else {"narrow_mps": 3.0}
    values = {f"{owner}.{name}": value for name, value in (gaps | paces).items()}
    changed = value_of(DriverParameters().with_values(values), owner)
    assert changed.squeezes == tuple(zip(gaps.values(), (math.inf, *paces.values()), strict=True))
    for wide, narrow in pairwise(names):
        with pytest.raises(InputError, match=f"^{narrow}"):
            DriverParameters().with_values(values | {f"{owner}.{narrow}": gaps[wide]})


def test_speeds_are_those_of_the_drivers_and_else_the_papers() -> None:
    own = {"emv_driver.corridor": 9.0, "emv_driver.gap_escape": 6.0}
    own |= {"civilian_driver.yielding": 7.0, "civilian_driver.pull_over": 4.0}
    speeds = DriverParameters().with_values({f"{owner}.speed_mps": mps for owner, mps in own.items()}).speeds(12.0)
    assert speeds == replace(PAPER_SPEEDS, **dict(zip(OWN_SPEEDS, (12.0, 12.0, 9.0, 6.0, 7.0, 4.0), strict=True)))
    known = DRIVER_PARAMETERS["emv_driver.corridor.speed_mps"]
    assert [known.at(share) for share in (0.0, 0.25, 1.0)] == [2.0, 6.5, 20.0]
    assert known.share_of(6.5) == 0.25
