"""Messages as YAML, CSV and dictionaries."""

import array
from collections import OrderedDict
from collections.abc import Iterator, Sequence
from typing import Any, Final

import numpy as np
import yaml

_ARRAYS: Final = (np.ndarray, array.array, list, tuple, bytes)


def get_message_slot_types(msg: Any) -> "OrderedDict[str, str]":
    """Field names of a message with their types, in the order of the definition."""
    return OrderedDict(msg.get_fields_and_field_types())


def _sequence(values: Any, kind: str, truncate_length: int | None, no_arr: bool, no_str: bool) -> Any:
    if no_arr:
        return f"<array type: {kind or 'unknown'}, length: {len(values)}>"
    cut = truncate_length is not None and len(values) > truncate_length
    kept = values[:truncate_length] if cut else values
    elements: Sequence[Any] = kept.tolist() if isinstance(kept, (np.ndarray, array.array)) else list(kept)
    return [_plain(element, "", truncate_length, no_arr, no_str) for element in elements] + (["..."] if cut else [])


def _plain(value: Any, kind: str, truncate_length: int | None, no_arr: bool, no_str: bool) -> Any:
    if hasattr(value, "get_fields_and_field_types"):
        fields = value.get_fields_and_field_types()
        return OrderedDict(
            (name, _plain(getattr(value, name), kind, truncate_length, no_arr, no_str)) for name, kind in fields.items()
        )
    if isinstance(value, str):
        if no_str:
            return f"<string length: <{len(value)}>>"
        cut = truncate_length is not None and len(value) > truncate_length
        return value[:truncate_length] + "..." if cut else value
    if isinstance(value, _ARRAYS):
        return _sequence(value, kind, truncate_length, no_arr, no_str)
    return value.item() if isinstance(value, np.generic) else value


def message_to_ordereddict(
    msg: Any, *, truncate_length: int | None = None, no_arr: bool = False, no_str: bool = False
) -> "OrderedDict[str, Any]":
    """A message as nested dictionaries, lists and scalars.

    Args:
        msg: The message.
        truncate_length: Longer arrays and strings are cut and end with ``...``; None keeps everything.
        no_arr: Only tell the type and length of arrays.
        no_str: Only tell the length of strings.
    """
    plain: OrderedDict[str, Any] = _plain(msg, "", truncate_length, no_arr, no_str)
    return plain


def _unordered(value: Any) -> Any:
    if isinstance(value, dict):
        return {name: _unordered(part) for name, part in value.items()}
    return [_unordered(part) for part in value] if isinstance(value, list) else value


def message_to_yaml(
    msg: Any,
    *,
    truncate_length: int | None = None,
    no_arr: bool = False,
    no_str: bool = False,
    flow_style: bool = False,
) -> str:
    """A message as a YAML document. Args: ``message_to_ordereddict``; ``flow_style`` puts it into one line."""
    plain = message_to_ordereddict(msg, truncate_length=truncate_length, no_arr=no_arr, no_str=no_str)
    return yaml.safe_dump(
        _unordered(plain), sort_keys=False, allow_unicode=True, width=2**20, default_flow_style=flow_style
    )


def _leaves(value: Any) -> Iterator[Any]:
    if isinstance(value, dict):
        for part in value.values():
            yield from _leaves(part)
    elif isinstance(value, list):
        for part in value:
            yield from _leaves(part)
    else:
        yield value


def message_to_csv(msg: Any, *, truncate_length: int | None = None, no_arr: bool = False, no_str: bool = False) -> str:
    """The values of a message, separated by commas. Args: ``message_to_ordereddict``."""
    plain = message_to_ordereddict(msg, truncate_length=truncate_length, no_arr=no_arr, no_str=no_str)
    return ",".join(map(str, _leaves(plain)))
