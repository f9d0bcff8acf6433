"""Content of messages that any program may have sent: JSON in text fields, one error for all that does not fit."""

import json
from collections.abc import Callable
from functools import wraps
from typing import Any, TypeVar

from siren_ros.errors import InputError

Read = TypeVar("Read")


def checks_content(read: Callable[[Any], Read]) -> Callable[[Any], Read]:
    """Decorate a reading function: errors of a message's content (an unknown code, bad JSON) become an InputError."""

    @wraps(read)
    def checked(message: Any) -> Read:
        try:
            return read(message)
        except (ValueError, TypeError, KeyError, OverflowError, RecursionError) as error:
            name = str(getattr(message, "__msgtype__", type(message).__name__))
            raise InputError(name, str(error), "a message with the content that its definition names") from error

    return checked


def json_object(text: str) -> dict[str, Any]:
    """The JSON object in a text field.

    Raises:
        ValueError, TypeError: The text is no JSON, or no object.
    """
    value = json.loads(text)
    if not isinstance(value, dict):
        raise TypeError(f"a JSON object is wanted, not {type(value).__name__}")
    return value


def json_text(value: object) -> str:
    """The JSON of a value, the same bytes for the same value."""
    return json.dumps(value, sort_keys=True, separators=(",", ":"), ensure_ascii=False)
