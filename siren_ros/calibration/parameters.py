"""The table of parameters that can be fitted: between what, and where each is put in an episode."""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

from siren_ros.behaviour.driving.step_view import BehaviourWorld
from siren_ros.errors import InputError
from siren_ros.scenario.paper import EmergencyLevel
from siren_ros.traffic.demand.plan import DriverModel, TrafficPlan

PutDriver = Callable[[DriverModel, float], DriverModel]
PutWorld = Callable[[BehaviourWorld, float], BehaviourWorld]


@dataclass(frozen=True)
class Parameter:
    """One parameter of the EMV."""

    name: str
    """``sumo.…`` works where SUMO drives the EMV (L0), ``controller.…`` where ROS does (L1 to L3)."""
    meaning: str
    low: float
    high: float
    driver: PutDriver | None = None
    """Sets it in SUMO's driver of the EMV."""
    world: PutWorld | None = None
    """Sets it in the controller."""

    def at(self, share: float) -> float:
        """The value at a share of the range."""
        return self.low + share * (self.high - self.low)

    def share_of(self, value: float) -> float:
        """Inverse of ``at``."""
        return (value - self.low) / (self.high - self.low)


def _speed(world: BehaviourWorld, value: float) -> BehaviourWorld:
    return replace(world, speeds=replace(world.speeds, emv_route_follow_mps=value, emv_lane_change_mps=value))


def _navigator(name: str) -> PutWorld:
    def put(world: BehaviourWorld, value: float) -> BehaviourWorld:
        emv = world.config.emv
        changed = replace(emv, navigator=replace(emv.navigator, **{name: value}))  # type: ignore[arg-type] # fields of float
        return replace(world, config=replace(world.config, emv=changed))

    return put


def _part(part: str, name: str) -> PutWorld:
    def put(world: BehaviourWorld, value: float) -> BehaviourWorld:
        changed = replace(getattr(world.config, part), **{name: value})
        return replace(world, config=replace(world.config, **{part: changed}))

    return put


def _driver(name: str) -> PutDriver:
    def put(driver: DriverModel, value: float) -> DriverModel:
        return replace(driver, **{name: value})  # type: ignore[arg-type] # the table names fields of float

    return put


def _driving(name: str) -> PutDriver:
    def put(driver: DriverModel, value: float) -> DriverModel:
        return replace(driver, driving=replace(driver.driving, **{name: value}))

    return put


PARAMETERS: Final[Mapping[str, Parameter]] = {
    one.name: one
    for one in (
        Parameter("controller.target_speed_mps", "speed on a free way", 8.0, 20.0, world=_speed),
        Parameter(
            "controller.accel_mps2", "acceleration", 0.8, 4.0, world=_navigator("comfort_accel_mps2")
        ),
        Parameter(
            "controller.lateral_accel_mps2", "lateral acceleration in bends", 1.0, 5.0,
            world=_navigator("lateral_accel_mps2"),
        ),
        Parameter(
            "controller.headway_s", "time kept to vehicles ahead", 0.4, 2.5, world=_part("anticipation", "headway_s")
        ),
        Parameter(
            "controller.approach_brake_mps2", "deceleration laid out for towards vehicles ahead", 0.5, 3.0,
            world=_part("anticipation", "brake_mps2"),
        ),
        Parameter(
            "controller.approach_gap_m", "standing distance to vehicles ahead", 3.0, 12.0,
            world=_part("anticipation", "standstill_gap_m"),
        ),
        Parameter(
            "controller.red_light_speed_mps", "speed at the line of a red light", 2.0, 12.0,
            world=_part("junction_entry", "speed_mps"),
        ),
        Parameter("sumo.speed_factor", "wished speed over the speed limit", 0.6, 1.0, driver=_driver("speed_factor")),
        Parameter("sumo.tau_s", "time headway", 0.5, 2.5, driver=_driver("tau_s")),
        Parameter("sumo.accel_mps2", "acceleration", 0.8, 4.0, driver=_driving("accel_mps2")),
        Parameter("sumo.decel_mps2", "comfortable deceleration", 1.5, 6.0, driver=_driving("decel_mps2")),
        Parameter("sumo.min_gap_m", "standing distance to the vehicle ahead", 1.0, 5.0, driver=_driving("min_gap_m")),
    )
}  # fmt: skip
"""Every parameter that can be fitted, by name. The ranges are those of driving that is physically sensible."""


def parameters_named(names: Sequence[str]) -> tuple[Parameter, ...]:
    """The parameters of some names, in their order.

    Raises:
        InputError: No name, one that is unknown, or one given twice.
    """
    for name in names:
        if name not in PARAMETERS:
            raise InputError("parameters", name, f"one or several of {', '.join(PARAMETERS)}")
    if not names or len(set(names)) < len(names):
        raise InputError("parameters", ",".join(names), "one or several names, each once")
    return tuple(PARAMETERS[name] for name in names)


def check_effect(parameters: Sequence[Parameter], levels: Collection[str]) -> None:
    """Refuse parameters that change nothing: SUMO's where ROS drives the EMV at all levels, and the other way round.

    Args:
        parameters: What is to be fitted.
        levels: Of the situations, by name.

    Raises:
        InputError: Names the parameter, and those that have an effect.
    """
    sumo_drives = EmergencyLevel.L0.name in levels
    ros_drives = any(level != EmergencyLevel.L0.name for level in levels)
    works = [one.name for one in PARAMETERS.values() if (one.driver and sumo_drives) or (one.world and ros_drives)]
    for one in parameters:
        if one.name not in works:
            raise InputError("parameters", one.name, f"at {', '.join(levels)} one or several of {', '.join(works)}")


def with_drivers(plan: TrafficPlan, values: Mapping[str, float]) -> TrafficPlan:
    """The plan with SUMO's parameters of all its EMVs."""
    emvs = plan.emvs
    for name, value in values.items():
        put = PARAMETERS[name].driver
        if put is not None:
            emvs = tuple(replace(emv, driver=put(emv.driver, value)) for emv in emvs)
    return replace(plan, emvs=emvs)


def with_world(world: BehaviourWorld, values: Mapping[str, float]) -> BehaviourWorld:
    """The controller's view with its parameters."""
    for name, value in values.items():
        put = PARAMETERS[name].world
        if put is not None:
            world = put(world, value)
    return world
