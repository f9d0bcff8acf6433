"""Fields of a message from dictionaries, as ``ros2 topic pub`` takes them."""

import array
from collections.abc import Mapping
from typing import Any

import numpy as np

from rosidl_runtime_py.utilities import get_message


def set_message_fields(msg: Any, values: Mapping[str, Any]) -> None:
    """Set fields of a message, nested ones too; fields that are not named stay.

    Raises:
        AttributeError: The message has no such field.
        TypeError: The values are no mapping, or one does not fit its field.
    """
    if not isinstance(values, Mapping):
        raise TypeError(f"values must be a dictionary: {values!r}")
    kinds = msg.get_fields_and_field_types()
    for name, value in values.items():
        if name not in kinds:
            raise AttributeError(f"'{type(msg).__name__}' object has no attribute '{name}'")
        setattr(msg, name, _value(getattr(msg, name), kinds[name], value))


def _value(present: Any, kind: str, value: Any) -> Any:
    if hasattr(present, "get_fields_and_field_types"):
        if not isinstance(value, type(present)):
            set_message_fields(present, value)
            return present
        return value
    if isinstance(present, np.ndarray):
        return np.array(value, dtype=present.dtype)
    if isinstance(present, array.array):
        return array.array(present.typecode, value)
    if isinstance(present, list):
        element = kind.removeprefix("sequence<").split("[")[0].split(",")[0].rstrip(">")
        return [_element(element, item) for item in value] if "/" in element else list(value)
    return type(present)(value)


def _element(kind: str, value: Any) -> Any:
    element = get_message(kind.replace("/", "/msg/"))()
    if isinstance(value, type(element)):
        return value
    set_message_fields(element, value)
    return element
