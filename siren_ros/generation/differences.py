"""The first difference between two structures: dataclasses, arrays, mappings, sequences and plain values."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass
from typing import Any, Final

import numpy as np

from siren_ros.interfaces.message_content import json_text

MISSING: Final = "nothing"
"""Stands for a value that one of the two structures lacks."""


@dataclass(frozen=True)
class Mismatch:
    """One value that is not the same."""

    path: tuple[str | int, ...]
    """Names of fields and keys, and positions, from the outermost structure on."""
    recorded: object
    repeated: object

    @property
    def name(self) -> str:
        """The path as text: ``parameters.request.seed``."""
        return ".".join(str(part) for part in self.path)


def first_mismatch(recorded: Any, repeated: Any) -> Mismatch | None:
    """The first value that is not the same to the last bit, in the order of fields, keys and positions."""
    return next(_mismatches(recorded, repeated, ()), None)


def _mismatches(recorded: Any, repeated: Any, path: tuple[str | int, ...]) -> Iterator[Mismatch]:
    if isinstance(recorded, np.ndarray) and isinstance(repeated, np.ndarray):
        yield from _array_mismatches(recorded, repeated, path)
    elif is_dataclass(recorded) and type(recorded) is type(repeated):
        for field in fields(recorded):
            values = (getattr(recorded, field.name), getattr(repeated, field.name))
            yield from _mismatches(*values, (*path, field.name))
    elif isinstance(recorded, Mapping) and isinstance(repeated, Mapping):
        for key in sorted({*recorded, *repeated}, key=str):
            values = (recorded.get(key, MISSING), repeated.get(key, MISSING))
            yield from _mismatches(*values, (*path, key))
    elif _is_sequence(recorded) and _is_sequence(repeated):
        for position in range(max(len(recorded), len(repeated))):
            one, other = (side[position] if position < len(side) else MISSING for side in (recorded, repeated))
            yield from _mismatches(one, other, (*path, position))
    elif not _same(recorded, repeated):
        yield Mismatch(path, recorded, repeated)


def _array_mismatches(recorded: Any, repeated: Any, path: tuple[str | int, ...]) -> Iterator[Mismatch]:
    if recorded.tobytes() == repeated.tobytes() and recorded.shape == repeated.shape:
        return
    if recorded.shape != repeated.shape or recorded.dtype != repeated.dtype:
        yield Mismatch((*path, "length"), len(recorded), len(repeated))
        return
    for position, (one, other) in enumerate(zip(recorded.ravel(), repeated.ravel(), strict=True)):
        if one.tobytes() != other.tobytes():
            yield Mismatch((*path, position), one.item(), other.item())


def _is_sequence(value: Any) -> bool:
    return isinstance(value, Sequence) and not isinstance(value, str | bytes)


def _same(recorded: Any, repeated: Any) -> bool:
    """Plain values by their text in JSON, so that 1 and 1.0, and 0.0 and −0.0, are two values."""
    for kind in (str, bytes, np.ndarray):
        if isinstance(recorded, kind) or isinstance(repeated, kind):
            return isinstance(recorded, kind) and isinstance(repeated, kind) and bool(recorded == repeated)
    return json_text(recorded) == json_text(repeated)
