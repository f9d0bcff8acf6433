"""The parameters that can be fitted: those of the drivers of EMVs, and where each is put in an episode."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from typing import Final

from siren_ros.errors import InputError
from siren_ros.simulation.behaviour.driving.step_view import BehaviourWorld
from siren_ros.simulation.scenario.driver_parameters import DRIVER_PARAMETERS, DriverParameter, DriverParameters
from siren_ros.simulation.scenario.paper import EmergencyLevel
from siren_ros.simulation.traffic.demand.plan import TrafficPlan, with_emv_drivers

_OF_SUMO: Final = "sumo."
_OF_ROS: Final = "emv_driver."
TARGET_SPEED: Final = "emv.speed_mps"
"""The template's parameter that is fitted too."""


PARAMETERS: Final[Mapping[str, DriverParameter]] = {
    TARGET_SPEED: DriverParameter(TARGET_SPEED, "speed on a free way", None, 8.0, 20.0),
    **{name: known for name, known in DRIVER_PARAMETERS.items() if name.startswith((_OF_SUMO, _OF_ROS))},
}
"""Every parameter that can be fitted, by name. The ranges are those of driving that is physically sensible.

``sumo.…`` acts where SUMO drives the EMV (L0), the others where ROS does (L1 to L3).
"""

FORMER_NAMES: Final[Mapping[str, str]] = {
    "controller.target_speed_mps": TARGET_SPEED,
    "controller.accel_mps2": "emv_driver.driving.comfort_accel_mps2",
    "controller.lateral_accel_mps2": "emv_driver.driving.lateral_accel_mps2",
    "controller.headway_s": "emv_driver.approach.headway_s",
    "controller.approach_brake_mps2": "emv_driver.approach.brake_mps2",
    "controller.approach_gap_m": "emv_driver.approach.standstill_gap_m",
    "controller.red_light_speed_mps": "emv_driver.lines.speed_mps",
}
"""Names that commands of earlier versions have; they still work."""


def parameters_named(names: Sequence[str]) -> tuple[DriverParameter, ...]:
    """Parameters by name, in the given order; InputError for no name, an unknown name, or a repeated one."""
    names = [FORMER_NAMES.get(name, name) for name in names]
    for name in names:
        if name not in PARAMETERS:
            raise InputError("parameters", name, f"one or several of {', '.join(PARAMETERS)}")
    if not names or len(set(names)) < len(names):
        raise InputError("parameters", ",".join(names), "one or several names, each once")
    return tuple(PARAMETERS[name] for name in names)


def check_effect(parameters: Sequence[DriverParameter], levels: Collection[str]) -> None:
    """Refuse parameters without an effect: SUMO's if ROS drives the EMV at all levels, and vice versa.

    Raises:
        InputError: Names the parameter, and those that have an effect.
    """
    sumo_drives = EmergencyLevel.L0.name in levels
    ros_drives = any(level != EmergencyLevel.L0.name for level in levels)
    works = [name for name in PARAMETERS if (sumo_drives if name.startswith(_OF_SUMO) else ros_drives)]
    for parameter in parameters:
        if parameter.name not in works:
            allowed = f"at {', '.join(levels)} one or several of {', '.join(works)}"
            raise InputError("parameters", parameter.name, allowed)


def with_drivers(plan: TrafficPlan, values: Mapping[str, float]) -> TrafficPlan:
    """The plan with SUMO's parameters of all its EMVs."""
    of_sumo = {name: value for name, value in values.items() if name.startswith(_OF_SUMO)}
    return with_emv_drivers(plan, DriverParameters().with_values(of_sumo).sumo)


def with_world(world: BehaviourWorld, values: Mapping[str, float]) -> BehaviourWorld:
    """The controller's view with its parameters.

    Raises:
        InputError: Margins that do not fall.
    """
    config = world.config.with_values({name: value for name, value in values.items() if name.startswith(_OF_ROS)})
    speed_mps = values.get(TARGET_SPEED, world.speeds.emv_route_follow_mps)
    return replace(world, config=config, speeds=config.speeds(speed_mps))
