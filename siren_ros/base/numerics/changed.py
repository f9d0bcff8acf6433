"""Copies frozen dataclasses with some fields changed, in a tenth of the time of ``dataclasses.replace``."""

from typing import Any, TypeVar

Structure = TypeVar("Structure")


def changed(structure: Structure, **changes: Any) -> Structure:
    """Copy a dataclass (without slots, and without its cached properties) with other values of some fields.

    Raises:
        TypeError: There is no such field.
    """
    kind = type(structure)
    if not changes.keys() <= structure.__dict__.keys():
        raise TypeError(f"{kind.__name__} has no field {', '.join(sorted(changes.keys() - structure.__dict__.keys()))}")
    other = object.__new__(kind)
    other.__dict__.update(structure.__dict__)
    other.__dict__.update(changes)
    return other
