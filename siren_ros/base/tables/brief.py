"""Short display of objects with long content, in consoles and notebooks, and columns as a frame of pandas."""

from collections.abc import Collection, Mapping
from dataclasses import fields, is_dataclass
from enum import Enum
from html import escape
from importlib import import_module
from pathlib import PurePath
from typing import Any, Final

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
