"""Dataclass fields that are parameters: default, description, allowed values, and their check."""

import dataclasses
from collections.abc import Callable, Sequence
from typing import Any

from siren_ros.errors import InputError

Value = bool | int | float | str | list[str]


def parameter(
    default: Any,
    description: str,
    *,
    minimum: float | None = None,
    maximum: float | None = None,
    choices: Sequence[str] = (),
    read: Callable[[object], str] | None = None,
) -> Any:
    """Define a dataclass field whose metadata contain what users must know to set it.

    A default that is a list is copied for every instance. ``choices`` are all allowed values, if they can be counted;
    ``read`` gives the choice that a word of the user stands for.
    """
    metadata = {
        "description": description,
        "minimum": minimum,
        "maximum": maximum,
        "choices": tuple(choices),
        "read": read,
    }
    if isinstance(default, list):
        return dataclasses.field(default_factory=lambda: list(default), metadata=metadata)
    return dataclasses.field(default=default, metadata=metadata)


def defaults_of(config_type: type[Any]) -> dict[str, Value]:
    """Defaults of all parameters of a config dataclass, by name."""
    config = config_type()
    return {field.name: getattr(config, field.name) for field in dataclasses.fields(config_type)}


def allowed_text(field: "dataclasses.Field[Any]", kind: type) -> str:
    """Text that says what a parameter accepts."""
    low, high, choices = (field.metadata.get(key) for key in ("minimum", "maximum", "choices"))
    if choices:
        return "one of " + ", ".join(repr(choice) for choice in choices)
    names = {bool: "true or false", int: "an integer", float: "a number", str: "a string", list: "a list of strings"}
    name = names[kind]
    if low is not None and high is not None:
        return f"{name} from {low:.12g} to {high:.12g}"
    if low is not None:
        return f"{name} of at least {low:g}"
    return name


def checked_value(field: "dataclasses.Field[Any]", default: Value, value: Any) -> Value:
    """Convert a value to the default's type.

    InputError for a wrong type, a number out of range, or an unknown choice.
    """
    kind = type(default)
    allowed = allowed_text(field, kind)
    if read := field.metadata.get("read"):
        value = read(value)
    if kind is float and isinstance(value, int) and not isinstance(value, bool):
        value = float(value)
    if kind is str and not isinstance(value, str) and isinstance(value, (int, float, bool)):
        raise InputError(field.name, value, allowed)
    if kind is list and (value is None or isinstance(value, (list, tuple))):
        value = [str(item) for item in value or ()]  # ROS reads an empty list in a parameter file as None
    if type(value) is not kind:
        raise InputError(field.name, value, allowed)
    low, high, choices = (field.metadata.get(key) for key in ("minimum", "maximum", "choices"))
    if isinstance(value, (int, float)) and not isinstance(value, bool):
        too_low = low is not None and value < low
        too_high = high is not None and value > high
        if too_low or too_high or value != value:  # noqa: PLR0124 - NaN is the only value that differs from itself
            raise InputError(field.name, value, allowed)
    if choices and value not in choices:
        raise InputError(field.name, value, allowed)
    return value


def check_fields(config: Any) -> None:
    """Check every field of a dataclass of parameters; InputError as ``checked_value``."""
    defaults = type(config)()
    for field in dataclasses.fields(config):
        checked_value(field, getattr(defaults, field.name), getattr(config, field.name))
