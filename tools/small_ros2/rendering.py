"""Messages as YAML, in the layout of the real ``ros2 topic echo``."""

import array
from collections.abc import Sequence
from typing import Any, Final

import numpy as np
import yaml

TRUNCATE_LENGTH: Final = 128
"""Longer arrays and strings are cut, as the real ``ros2 topic echo`` does."""


def plain(value: Any, truncate_length: int | None) -> Any:
    """A message, or a part of one, as dicts, lists and scalars.

    Args:
        value: A message or the value of a field.
        truncate_length: Arrays and strings longer than this are cut and end with ``...``; None keeps everything.
    """
    if hasattr(value, "get_fields_and_field_types"):
        return {name: plain(getattr(value, name), truncate_length) for name in value.get_fields_and_field_types()}
    if isinstance(value, str):
        cut = truncate_length is not None and len(value) > truncate_length
        return value[:truncate_length] + "..." if cut else value
    if isinstance(value, bytes):
        return plain(list(value), truncate_length)
    if isinstance(value, (np.ndarray, array.array, list, tuple)):
        return plain_sequence(value, truncate_length)
    return value.item() if isinstance(value, np.generic) else value


def plain_sequence(values: Sequence[Any] | np.ndarray[Any, Any], truncate_length: int | None) -> list[Any]:
    """The elements of a sequence field, cut to the length."""
    cut = truncate_length is not None and len(values) > truncate_length
    kept = values[:truncate_length] if cut else values
    elements = kept.tolist() if isinstance(kept, (np.ndarray, array.array)) else list(kept)
    return [plain(element, truncate_length) for element in elements] + (["..."] if cut else [])


def to_yaml(message: Any, truncate_length: int | None = TRUNCATE_LENGTH) -> str:
    """One message as a YAML document without its separator."""
    return yaml.safe_dump(plain(message, truncate_length), sort_keys=False, allow_unicode=True, width=2**20)
