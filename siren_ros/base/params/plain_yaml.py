"""Reads YAML from untrusted sources: no tags that build objects, no aliases, limited size and depth."""

from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from typing import Any, Final

import yaml

MAX_BYTES: Final = 256_000
"""Largest file that is read; our largest has 5 kB."""
MAX_DEPTH: Final = 32
_LOADER: Final = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
"""PyYAML's safe loader, in C if the wheel has it."""


def read_text(file: Path) -> str:
    """Read the text of a YAML file.

    Raises:
        OSError: It cannot be read, or is no file.
        ValueError: It is not UTF-8, too large, or its path is none.
    """
    if file.exists() and not file.is_file():
        raise OSError(f"{file} is no file")
    with file.open("rb") as stream:
        data = stream.read(MAX_BYTES + 1)
    if len(data) > MAX_BYTES:
        raise ValueError(f"more than {MAX_BYTES} bytes")
    return data.decode("utf-8")


@lru_cache(maxsize=64)
def compose(text: str) -> yaml.Node | None:
    """Parse a document to YAML nodes; yaml.YAMLError if it is invalid.

    The same text is parsed once in a process, however many parts of an episode read it. Readers leave the nodes as
    they are.
    """
    node: yaml.Node | None = _guarded(lambda: yaml.compose(text, Loader=_LOADER), text)
    return node


def load(text: str) -> Any:
    """Parse a document to mappings, lists, texts, numbers, dates; yaml.YAMLError if it is invalid."""
    return _guarded(lambda: yaml.load(text, Loader=_LOADER), text)  # noqa: S506 - a safe loader


def reason_of(error: yaml.YAMLError) -> str:
    """The fault in one line; PyYAML's own text has several."""
    return " ".join(str(error).split())


def _guarded(action: Callable[[], Any], text: str) -> Any:
    """Check the events of a document before an action.

    Aliases could expand without end, and deep nesting exhausts the stack.
    """
    depth = 0
    try:
        for event in yaml.parse(text, Loader=_LOADER):
            if isinstance(event, yaml.AliasEvent):
                raise yaml.YAMLError("an alias; write the value out")
            depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
            if depth > MAX_DEPTH:
                raise yaml.YAMLError(f"more than {MAX_DEPTH} levels")
        return action()
    except (ValueError, TypeError, LookupError, AttributeError, OverflowError, RecursionError) as error:
        # PyYAML does not convert all errors of its value conversions, for example of the date 2001-99-99.
        raise yaml.YAMLError(f"a value that cannot be read ({error})") from error
