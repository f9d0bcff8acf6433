"""Declares ROS parameters from the fields of a frozen dataclass, so that each default exists once.

A parameter on the command line that no node declares is an error.
"""

import dataclasses
from collections.abc import Iterable, Mapping
from typing import Any, Final, TypeVar

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.node import Node
from rclpy.parameter import Parameter

from siren_ros.base.params.parameters import Value, allowed_text, checked_value, defaults_of
from siren_ros.errors import InputError

Config = TypeVar("Config")


def _descriptor(field: "dataclasses.Field[Any]", default: Value) -> ParameterDescriptor:
    low, high = field.metadata.get("minimum"), field.metadata.get("maximum")
    descriptor = ParameterDescriptor(
        description=field.metadata.get("description", ""),
        additional_constraints=allowed_text(field, type(default)),
        read_only=True,
        dynamic_typing=True,
    )
    unbounded = float(2**53)
    if low is not None or high is not None:
        first, last = low if low is not None else -unbounded, high if high is not None else unbounded
        if isinstance(default, int) and not isinstance(default, bool):
            descriptor.integer_range = [IntegerRange(from_value=int(first), to_value=int(last), step=0)]
        elif isinstance(default, float):
            descriptor.floating_point_range = [FloatingPointRange(from_value=float(first), to_value=float(last))]
    return descriptor


SEALED: Final[set[str]] = set()
"""Salts of the sealed episodes of this process."""


def declare_config(node: Node, config_type: type[Config]) -> Config:
    """Declare every field of a config dataclass as a parameter and return the config with the values set.

    Values are checked here, before ROS sees them, so that a bad one gives one line that names it. In the process of a
    sealed episode ROS sees the defaults alone, because every program in the graph can ask for parameters.

    Raises:
        InputError: A value of the wrong type or out of range.
    """
    overrides = node._parameter_overrides  # noqa: SLF001 - rclpy cannot read a value before its declaration
    values: dict[str, Value] = {}
    if "salt" in overrides and overrides["salt"].value:
        SEALED.add(str(overrides["salt"].value))
    for field in dataclasses.fields(config_type):  # type: ignore[arg-type] # TypeVar of any dataclass
        default = defaults_of(config_type)[field.name]
        given = overrides.get(field.name)
        value = default if given is None else checked_value(field, default, given.value)
        if given is not None:
            overrides[field.name] = Parameter(field.name, value=value)
        if SEALED:
            overrides.pop(field.name, None)
        node.declare_parameter(field.name, default if SEALED else value, _descriptor(field, default))
        values[field.name] = value
    return config_type(**values)


BUILT_IN = frozenset({"use_sim_time", "start_type_description_service"})


def check_names(given: Mapping[str, Any], declared: Iterable[str]) -> None:
    """Refuse overrides of unknown parameters.

    Raises:
        InputError: Names the first unknown parameter and the known ones.
    """
    known = sorted(set(declared))
    for name in sorted(given):
        if name not in known and name not in BUILT_IN and not name.startswith("qos_overrides."):
            raise InputError(
                name, getattr(given[name], "value", given[name]), "one of the parameters " + ", ".join(known)
            )
