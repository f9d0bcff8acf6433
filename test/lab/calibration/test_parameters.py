"""Each parameter changes what it names, and nothing else."""

from contextlib import nullcontext
from dataclasses import fields, is_dataclass, replace
from typing import Any

import pytest

from siren_ros.errors import InputError
from siren_ros.lab.calibration.parameters import (
    FORMER_NAMES,
    PARAMETERS,
    Parameter,
    check_effect,
    parameters_named,
    with_drivers,
    with_world,
)
from siren_ros.simulation.behaviour.driving.step_view import BehaviourWorld
from siren_ros.simulation.roads.road_network import RoadNetwork
from siren_ros.simulation.scenario.driver_parameters import DriverParameters
from siren_ros.simulation.scenario.paper import LEVEL_POLICIES, EmergencyLevel
from siren_ros.simulation.scenario.presets import load_preset
from siren_ros.simulation.traffic.demand.plan import ClassDriving, DriverModel, PlannedVehicle, TrafficPlan
from siren_ros.simulation.world.actors import ActorClass

DRIVER = DriverModel("IDM", 1.1, 1.2, 1.0, 0.6, 1.0, ClassDriving(2.2, 3.5, 2.0, 42.0))
CHANGED = {
    "emv.speed_mps": {"emv_route_follow_mps", "emv_lane_change_mps"},
    "emv_driver.corridor.speed_mps": {"emv_driver.corridor.speed_mps", "emv_copy_sumo_mps"},
    "emv_driver.gap_escape.speed_mps": {"emv_driver.gap_escape.speed_mps", "emv_gap_escape_mps"},
    "sumo.speed_factor": {"speed_factor"},
    "sumo.tau_s": {"tau_s"},
    "sumo.accel_mps2": {"driving.accel_mps2"},
    "sumo.decel_mps2": {"driving.decel_mps2"},
    "sumo.min_gap_m": {"driving.min_gap_m"},
}
"""What a parameter changes; the others change the field of their own name."""


def world() -> BehaviourWorld:
    network = RoadNetwork((), (), (), {}, (0.0, 0.0), "!")
    return BehaviourWorld(network, LEVEL_POLICIES[EmergencyLevel.L1], {}, load_preset("paper"), 0)


def changes(old: Any, new: Any) -> dict[str, tuple[Any, Any]]:
    """Dotted names of the fields that differ, with both values."""
    pairs: dict[str, tuple[Any, Any]] = {}
    for field in fields(old):
        before, after = getattr(old, field.name), getattr(new, field.name)
        if is_dataclass(before):
            pairs |= {f"{field.name}.{name}": pair for name, pair in changes(before, after).items()}
        elif before != after:
            pairs[field.name] = before, after
    return pairs


def plan_of(driver: DriverModel) -> TrafficPlan:
    """An EMV and a civilian with one driver."""
    nowhere: Any = None
    vehicle = PlannedVehicle("emv", ActorClass.AMBULANCE, 6.0, 2.2, 2.6, (1, 1, 1), driver, (), nowhere, is_emv=True)
    return TrafficPlan((vehicle,), (replace(vehicle, name="c", is_emv=False),), (), (), (), 1, 0, 40.0)


@pytest.mark.parametrize("parameter", PARAMETERS.values(), ids=lambda parameter: parameter.name)
def test_a_parameter_changes_its_fields_and_no_others(parameter: Parameter) -> None:
    share = 0.07 if "gap_m" in parameter.name or "clearance_m" in parameter.name else 0.77  # margins fall
    value = parameter.at(share)
    assert parameter.share_of(value) == pytest.approx(share)
    if parameter.of_sumo:
        changed = changes(DRIVER, with_drivers(plan_of(DRIVER), {parameter.name: value}).emvs[0].driver)
        assert with_world(world(), {parameter.name: value}).config == DriverParameters()
    else:
        before, after = world(), with_world(world(), {parameter.name: value})
        changed = changes(before.config, after.config) | changes(before.speeds, after.speeds)
        present = [old for old, _ in changed.values() if old is not None]
        assert all(parameter.low <= old <= parameter.high for old in present), "the present value is in the range"
    assert set(changed) == CHANGED.get(parameter.name, {parameter.name})
    assert {new for _, new in changed.values()} == {value}


def test_only_the_emvs_drivers_change() -> None:
    plan = plan_of(DRIVER)
    changed = with_drivers(plan, {"sumo.tau_s": 2.0, "emv_driver.approach.headway_s": 1.0})
    assert changed.emvs[0].driver == replace(DRIVER, tau_s=2.0)
    assert changed.groups == plan.groups


def test_former_names_still_work() -> None:
    assert [parameter.name for parameter in parameters_named(list(FORMER_NAMES))] == list(FORMER_NAMES.values())
    with pytest.raises(InputError, match="each once"):
        parameters_named(["controller.target_speed_mps", "emv.speed_mps"])


@pytest.mark.parametrize("names", [[], ["sumo.tau_s", "sumo.tau_s"], ["sumo.mood"]])
def test_unusable_names_are_refused(names: list[str]) -> None:
    with pytest.raises(InputError, match="parameters"):
        parameters_named(names)


@pytest.mark.parametrize(
    ("name", "levels", "works"),
    [
        ("sumo.tau_s", ["L0"], True),
        ("sumo.tau_s", ["L1", "L3"], False),
        ("emv_driver.approach.headway_s", ["L0"], False),
        ("emv_driver.approach.headway_s", ["L2"], True),
        ("emv_driver.approach.headway_s", ["L0", "L1"], True),
        ("sumo.tau_s", ["L0", "L1"], True),
    ],
)
def test_a_parameter_without_effect_at_any_level_is_refused(name: str, levels: list[str], works: bool) -> None:
    with nullcontext() if works else pytest.raises(InputError, match=name):
        check_effect(parameters_named([name]), levels)
