"""Parameters of drivers: names, ranges, and who goes first."""

import pytest

from siren_ros.errors import InputError
from siren_ros.simulation.scenario.driver_parameters import DRIVER_PARAMETERS, DriverParameters, driver_parameters

HEADWAY, GAIN = "civilian_driver.driving.headway_s", "emv_driver.pass_gain_m"


def value_of(parameters: object, name: str) -> object:
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


def test_margins_fall() -> None:
    wide, narrow = "emv_driver.corridor.narrow_gap_m", "emv_driver.corridor.tight_gap_m"
    corridor = DriverParameters().with_values({wide: 1.0, narrow: 0.5}).emv_driver.corridor
    assert [margin for margin, _ in corridor.squeezes] == [1.0, 0.5, 0.1]
    with pytest.raises(InputError, match="tight_gap_m"):
        DriverParameters().with_values({narrow: 0.3})
    with pytest.raises(InputError, match="clearance_m"):
        DriverParameters().with_values({"civilian_driver.manoeuvring.narrow_gap_m": 0.1})
