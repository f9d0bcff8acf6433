"""The table of parameters that can be fitted: between what, and where each is put in an episode."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final, TypeVar

from siren_ros.errors import InputError
from siren_ros.simulation.behaviour.driving.step_view import BehaviourWorld
from siren_ros.simulation.scenario.paper import EmergencyLevel
from siren_ros.simulation.traffic.demand.plan import DriverModel, TrafficPlan

Structure = TypeVar("Structure", DriverModel, BehaviourWorld)


@dataclass(frozen=True)
class Parameter:
    """One parameter of the EMV."""

    name: str
    """``sumo.…`` works where SUMO drives the EMV (L0), ``controller.…`` where ROS does (L1 to L3)."""
    meaning: str
    low: float
    high: float
    fields: tuple[str, ...] = ()
    """Dotted names of what it sets: in SUMO's ``DriverModel`` of the EMV, or in the controller's ``BehaviourWorld``."""

    @property
    def of_sumo(self) -> bool:
        """Whether SUMO's driver has it, and not the controller."""
        return self.name.startswith("sumo.")

    def at(self, share: float) -> float:
        """The value at a share of the range."""
        return self.low + share * (self.high - self.low)

    def share_of(self, value: float) -> float:
        """Inverse of ``at``."""
        return (value - self.low) / (self.high - self.low)

    def put(self, structure: Structure, value: float) -> Structure:
        """A copy of a driver or a world with the value."""
        for field in self.fields:
            structure = _with_field(structure, field, value)
        return structure


def _with_field(structure: Any, field: str, value: float) -> Any:
    name, _, rest = field.partition(".")
    return replace(structure, **{name: _with_field(getattr(structure, name), rest, value) if rest else value})


PARAMETERS: Final[Mapping[str, Parameter]] = {
    name: Parameter(name, meaning, low, high, tuple(fields))
    for name, meaning, low, high, *fields in (
        ("controller.target_speed_mps", "speed on a free way", 8.0, 20.0,
         "speeds.emv_route_follow_mps", "speeds.emv_lane_change_mps"),
        ("controller.accel_mps2", "acceleration", 0.8, 4.0, "config.emv.navigator.comfort_accel_mps2"),
        ("controller.lateral_accel_mps2", "lateral acceleration in bends", 1.0, 5.0,
         "config.emv.navigator.lateral_accel_mps2"),
        ("controller.headway_s", "time kept to vehicles ahead", 0.4, 2.5, "config.anticipation.headway_s"),
        ("controller.approach_brake_mps2", "deceleration laid out for towards vehicles ahead", 0.5, 3.0,
         "config.anticipation.brake_mps2"),
        ("controller.approach_gap_m", "standing distance to vehicles ahead", 3.0, 12.0,
         "config.anticipation.standstill_gap_m"),
        ("controller.red_light_speed_mps", "speed at red lights and other lines without right of way", 2.0, 12.0,
         "config.junction_entry.speed_mps"),
        ("sumo.speed_factor", "wished speed over the speed limit", 0.6, 1.0, "speed_factor"),
        ("sumo.tau_s", "time headway", 0.5, 2.5, "tau_s"),
        ("sumo.accel_mps2", "acceleration", 0.8, 4.0, "driving.accel_mps2"),
        ("sumo.decel_mps2", "comfortable deceleration", 1.5, 6.0, "driving.decel_mps2"),
        ("sumo.min_gap_m", "standing distance to the vehicle ahead", 1.0, 5.0, "driving.min_gap_m"),
    )
}  # fmt: skip
"""Every parameter that can be fitted, by name. The ranges are those of driving that is physically sensible."""


def parameters_named(names: Sequence[str]) -> tuple[Parameter, ...]:
    """The parameters of some names, in their order; InputError for no name, an unknown name, or a name twice."""
    for name in names:
        if name not in PARAMETERS:
            raise InputError("parameters", name, f"one or several of {', '.join(PARAMETERS)}")
    if not names or len(set(names)) < len(names):
        raise InputError("parameters", ",".join(names), "one or several names, each once")
    return tuple(PARAMETERS[name] for name in names)


def check_effect(parameters: Sequence[Parameter], levels: Collection[str]) -> None:
    """Refuse parameters that change nothing: SUMO's where ROS drives the EMV at all levels, and the other way round.

    Raises:
        InputError: Names the parameter, and those that have an effect.
    """
    sumo_drives = EmergencyLevel.L0.name in levels
    ros_drives = any(level != EmergencyLevel.L0.name for level in levels)
    works = [name for name, known in PARAMETERS.items() if (sumo_drives if known.of_sumo else ros_drives)]
    for parameter in parameters:
        if parameter.name not in works:
            allowed = f"at {', '.join(levels)} one or several of {', '.join(works)}"
            raise InputError("parameters", parameter.name, allowed)


def with_drivers(plan: TrafficPlan, values: Mapping[str, float]) -> TrafficPlan:
    """The plan with SUMO's parameters of all its EMVs."""
    emvs = plan.emvs
    for name, value in values.items():
        if PARAMETERS[name].of_sumo:
            emvs = tuple(replace(emv, driver=PARAMETERS[name].put(emv.driver, value)) for emv in emvs)
    return replace(plan, emvs=emvs)


def with_world(world: BehaviourWorld, values: Mapping[str, float]) -> BehaviourWorld:
    """The controller's view with its parameters."""
    for name, value in values.items():
        if not PARAMETERS[name].of_sumo:
            world = PARAMETERS[name].put(world, value)
    return world
