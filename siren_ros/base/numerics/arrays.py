"""Array types named by their content, and independent random generators from the episode's one seed.

Shapes and units stand where the arrays are used.
"""

from collections.abc import Iterable, Sequence
from dataclasses import fields
from functools import cached_property
from typing import Any, Final, Self

import numpy as np
import numpy.typing as npt

from siren_ros.base.tables.brief import Brief, data_frame

Floats = npt.NDArray[np.float64]
Floats32 = npt.NDArray[np.float32]
Points = npt.NDArray[np.float64]
"""Coordinates in metres, ``(N, 2)`` unless stated otherwise."""
Matrix = npt.NDArray[np.float64]
Ids = npt.NDArray[np.uint32]
"""Ids of actors."""
Codes = npt.NDArray[np.uint8]
"""Codes of an enumeration."""
Flags = npt.NDArray[np.bool_]
Rows = npt.NDArray[np.intp]
"""Indices into other arrays."""


def random_stream(seed: int, purpose: str, index: int = 0) -> np.random.Generator:
    """Make a generator that depends only on seed, purpose and index, not on numbers drawn elsewhere.

    The purpose says what the numbers are for, such as ``demand``; the index tells streams of one purpose apart, an
    actor id for example. Seed and index are at least 0.
    """
    return np.random.default_rng(np.random.SeedSequence([seed, index, *purpose.encode()]))


def chances(weights: Iterable[float]) -> Floats:
    """Cumulative shares of weighted choices, from 0 to 1; the input of ``drawn``."""
    shares = np.array([*weights])
    ends = (shares / shares.sum()).cumsum()
    return np.asarray(ends / ends[-1])


def drawn(ends: Floats, rng: np.random.Generator) -> int:
    """Draw a choice by its weight. It uses and draws the same random numbers as ``Generator.choice``."""
    return int(ends.searchsorted(rng.random(), side="right"))


_ELEMENTS: Final[dict[Any, type[np.generic]]] = {
    npt.NDArray[kind]: kind  # type: ignore[valid-type] # a value, not an annotation
    for kind in (np.dtype(code).type for code in np.typecodes["All"])
}
"""Element type of each array type. A table is needed because numpy versions build array types differently."""


def dtypes_of(kind: Any) -> dict[str, type[np.generic]]:
    """Element types of a dataclass's array fields as their annotations say, in declaration order."""
    return {field.name: _ELEMENTS[field.type] for field in fields(kind) if field.type in _ELEMENTS}


class Columns(Brief):
    """Base of a dataclass whose fields are arrays of shape ``(N,)``: row i of all fields belongs to one item.

    A field that is no array holds for all items, such as the step of ``ActorStates``.
    """

    def __len__(self) -> int:
        return len(getattr(self, _names(type(self))[0]))

    @cached_property
    def columns(self) -> Floats:
        """All fields in declaration order as one array, shape ``(fields, N)``, for compiled loops."""
        return np.array([getattr(self, name) for name in _names(type(self))], dtype=np.float64)

    @classmethod
    def of_columns(cls, columns: Floats) -> Self:
        """Make the items from an array as ``columns`` gives it."""
        made = cls(*columns)
        made.__dict__["columns"] = columns
        return made

    def to_pandas(self) -> Any:
        """A ``pandas.DataFrame`` with a column for each field, in declaration order.

        Raises:
            InputError: pandas is not installed.
        """
        return data_frame({name: getattr(self, name) for name in _names(type(self))})

    def select(self, rows: Flags | Rows) -> Self:
        """Select the items of some rows (a mask or indices)."""
        fields_now = (getattr(self, name) for name in _names(type(self)))
        return type(self)(*(one[rows] if isinstance(one, np.ndarray) else one for one in fields_now))

    @classmethod
    def joined(cls, parts: Sequence[Self]) -> Self:
        """Join the items of all parts, in order."""
        return cls(*(np.concatenate([getattr(part, name) for part in parts]) for name in _names(cls)))

    @classmethod
    def where(cls, mask: Flags, chosen: Self, other: Self) -> Self:
        """Take rows of ``chosen`` where the mask is true, and of ``other`` elsewhere."""
        return cls(*(np.where(mask, getattr(chosen, name), getattr(other, name)) for name in _names(cls)))


def _names(kind: Any) -> tuple[str, ...]:
    return tuple(kind.__dataclass_fields__)
