"""Content of messages that any program may have sent: texts, JSON in them, one error for all that does not fit."""

import json
from collections.abc import Callable
from functools import wraps
from typing import Any, Final, TypeVar

from siren_ros.errors import InputError

Read = TypeVar("Read")
LONGEST_TEXT: Final = 1000
"""Characters of a text that is shown; another program's error may be of any length."""


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


def shown_text(text: str, most: int = LONGEST_TEXT) -> str:
    """A text of another program as one line for a terminal: without control characters, and not endless."""
    if text.isprintable() and len(text) <= most:
        return text
    line = "".join(
        letter if letter.isprintable() else letter.encode("unicode_escape").decode() for letter in text[:most]
    )
    return line if len(text) <= most else f"{line}… ({len(text)} characters)"


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
