"""YAML from strangers: no tags that build objects, no aliases that unfold without end, a bounded size and depth."""

from pathlib import Path
from typing import Any, Final

import yaml

MAX_BYTES: Final = 256_000
"""Our largest file has 5 kB; PyYAML reads about 100 kB a second."""
MAX_DEPTH: Final = 32


class PlainLoader(yaml.SafeLoader):
    """PyYAML's safe loader, which refuses aliases and deep nesting."""

    def __init__(self, stream: Any) -> None:
        super().__init__(stream)
        self._depth = 0

    def compose_node(self, parent: yaml.Node | None, index: int) -> yaml.Node | None:
        """PyYAML's hook for every node."""
        if self.check_event(yaml.AliasEvent):
            raise yaml.YAMLError("an alias; write the value out")
        if self._depth >= MAX_DEPTH:
            raise yaml.YAMLError(f"more than {MAX_DEPTH} levels")
        self._depth += 1
        node: yaml.Node | None = super().compose_node(parent, index)
        self._depth -= 1
        return node


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


def compose(text: str) -> yaml.Node | None:
    """The nodes of a document; yaml.YAMLError where it is none."""
    node: yaml.Node | None = _guarded(lambda: yaml.compose(text, Loader=PlainLoader))
    return node


def load(text: str) -> Any:
    """The values of a document: mappings, lists, texts, numbers, dates; yaml.YAMLError where it is none."""
    return _guarded(lambda: yaml.load(text, Loader=PlainLoader))  # noqa: S506 - a safe loader


def _guarded(action: Any) -> Any:
    try:
        return action()
    except (ValueError, TypeError, LookupError, AttributeError, OverflowError, RecursionError) as error:
        # PyYAML lets through what its conversions raise, for example on the date 2001-99-99.
        raise yaml.YAMLError(f"a value that cannot be read ({error})") from error
