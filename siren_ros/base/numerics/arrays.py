"""Array types named by their content, structures of arrays, and random generators from the episode's one seed.

Shapes and units stand where the arrays are used. Structures with long content show themselves briefly in consoles and
notebooks (``Brief``), and ``changed`` copies a frozen one with other values of some fields.
"""

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import fields, is_dataclass
from enum import Enum
from functools import cached_property
from html import escape
from importlib import import_module
from pathlib import PurePath
from typing import Any, Final, Self, TypeVar

import numpy as np
import numpy.typing as npt

from siren_ros.errors import InputError

_LONGEST_VALUE: Final = 72
"""Maximum length of one value in a display."""
_LONGEST_REPR: Final = 800
"""Maximum length of a whole display."""
_LISTED: Final = 6
"""A collection with more items, or with complex items, is shown as its number of items."""
_PLAIN: Final = (str, int, float, bool, type(None), PurePath)


class Brief:
    """Base of dataclasses with long content: ``repr`` and notebooks show their facts in short form.

    The facts are the fields. A class whose fields do not tell what its object is has a ``facts`` of its own. Arrays
    show their type and shape, long collections the number of their items.
    """

    __slots__ = ()

    def __init_subclass__(cls, **options: Any) -> None:
        """Keep this class's ``__repr__``.

        The decorator ``dataclass`` replaces one that a class inherits, but not its own.
        """
        super().__init_subclass__(**options)
        if "__repr__" not in cls.__dict__:
            cls.__repr__ = Brief.__repr__  # type: ignore[method-assign]

    def facts(self) -> Mapping[str, object]:
        """What the object is, as values by name; by default its fields."""
        return {field.name: getattr(self, field.name) for field in fields(self) if field.repr}  # type: ignore[arg-type]

    def __repr__(self) -> str:
        text = ", ".join(f"{name}={brief(value)}" for name, value in self.facts().items())
        return f"{type(self).__name__}({_cut(text, _LONGEST_REPR)})"

    def _repr_html_(self) -> str:
        """The facts as an HTML table of two columns, for Jupyter."""
        rows = "".join(
            f'<tr><th scope="row">{escape(name)}</th><td>{escape(brief(value))}</td></tr>'
            for name, value in self.facts().items()
        )
        return f"<table><caption>{escape(type(self).__name__)}</caption><tbody>{rows}</tbody></table>"


def brief(value: object) -> str:
    """A value in at most 72 letters: plain values in Python's notation, others by kind and size."""
    if isinstance(value, Enum):
        text = value.name
    elif isinstance(value, float):
        text = f"{float(value):.6g}"
    elif isinstance(value, str | PurePath):
        text = repr(_cut(str(value), _LONGEST_VALUE))
    elif value is None or isinstance(value, int):
        text = repr(value)
    elif hasattr(value, "dtype") and hasattr(value, "shape"):
        text = _of_array(value)
    elif isinstance(value, Collection) and not isinstance(value, Brief):
        text = _of_collection(value)
    else:
        text = _cut(repr(value), _LONGEST_VALUE) if is_dataclass(value) else f"<{type(value).__name__}>"
    return text


def _of_array(array: Any) -> str:
    kind = "record" if array.dtype.names else str(array.dtype)
    return f"<{kind} {'×'.join(map(str, array.shape)) or 'scalar'}>"


def _of_collection(items: Collection[object]) -> str:
    values = items.values() if isinstance(items, Mapping) else items
    if len(items) <= _LISTED and all(isinstance(item, _PLAIN) for item in values):
        text = repr(dict(items) if isinstance(items, Mapping) else items)
        if len(text) <= _LONGEST_VALUE:
            return text
    return f"<{type(items).__name__} of {len(items)}>"


def _cut(text: str, longest: int) -> str:
    return text if len(text) <= longest else f"{text[: longest - 1]}…"


def data_frame(columns: Mapping[str, Any]) -> Any:
    """A ``pandas.DataFrame`` from columns of equal length.

    Raises:
        InputError: pandas is not installed; nothing else of the library needs it.
    """
    try:
        pandas = import_module("pandas")
    except ImportError as error:
        raise InputError("to_pandas", "no pandas", "an environment with pandas: pip install pandas") from error
    return pandas.DataFrame(dict(columns))


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
