"""Safe YAML, for files of any origin: no tags that build objects, no aliases, a bounded size and depth."""

from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from typing import Any, Final

import yaml

MAX_BYTES: Final = 256_000
"""Our largest file has 5 kB."""
MAX_DEPTH: Final = 32
_LOADER: Final = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
"""PyYAML's safe loader, in C where the wheel has it."""


def read_text(file: Path) -> str:
    """The text of a YAML file.

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
    """The nodes of a document; yaml.YAMLError where it is none.

    The same text is parsed once in a process, however many parts of an episode read it. Readers leave the nodes as
    they are.
    """
    node: yaml.Node | None = _guarded(lambda: yaml.compose(text, Loader=_LOADER), text)
    return node


def load(text: str) -> Any:
    """The values of a document: mappings, lists, texts, numbers, dates; yaml.YAMLError where it is none."""
    return _guarded(lambda: yaml.load(text, Loader=_LOADER), text)  # noqa: S506 - a safe loader


def reason_of(error: yaml.YAMLError) -> str:
    """What is wrong, in one line; PyYAML's own text has several."""
    return " ".join(str(error).split())


def _guarded(action: Callable[[], Any], text: str) -> Any:
    """Looks at the events first: aliases may unfold without end, and deep nesting exhausts the stack."""
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
        # PyYAML lets through what its conversions raise, for example on the date 2001-99-99.
        raise yaml.YAMLError(f"a value that cannot be read ({error})") from error
