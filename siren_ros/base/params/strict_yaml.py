"""Reads parameter files key by key. Errors name file, line, key, value and what is allowed."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path

import yaml

from siren_ros.base.params import plain_yaml
from siren_ros.errors import InputError

_TAG = "tag:yaml.org,2002:"


@dataclass
class StrictMapping:
    """A YAML mapping in which every key must be read.

    Each reader method removes the key from what is left; ``finish`` refuses the rest as unknown.
    """

    file: str
    path: str
    node: yaml.MappingNode
    values: dict[str, yaml.Node] = field(init=False)
    _known: list[str] = field(init=False, default_factory=list)

    def __post_init__(self) -> None:
        self.values = {}
        for key, value in self.node.value:
            if not isinstance(key, yaml.ScalarNode):
                raise InputError(self.where("", key), _shown(key), "keys that are texts")
            name = str(key.value)
            if name in self.values:
                raise InputError(self.where(name, key), name, "each key once")
            self.values[name] = value

    def where(self, key: str, node: yaml.Node | None = None) -> str:
        """Place of a key for error messages: ``file:line: path.key``."""
        marked = node or self.values.get(key, self.node)
        full = f"{self.path}.{key}" if self.path else key
        return f"{self.file}:{marked.start_mark.line + 1}: {full}"

    def has(self, key: str) -> bool:
        """Whether an optional key exists."""
        self._known.append(key)
        return key in self.values

    def is_mapping(self, key: str) -> bool:
        """Whether a key's value is a mapping, for keys that may also be a text."""
        return isinstance(self.values.get(key), yaml.MappingNode)

    def _take(self, key: str, allowed: str) -> yaml.Node:
        self._known.append(key)
        if key not in self.values:
            raise InputError(self.where(key), None, f"{allowed}; the key is missing")
        return self.values[key]

    def _scalar(self, key: str, tags: tuple[str, ...], allowed: str) -> str:
        node = self._take(key, allowed)
        if not isinstance(node, yaml.ScalarNode) or node.tag not in {_TAG + tag for tag in tags}:
            raise InputError(self.where(key), _shown(node), allowed)
        return str(node.value)

    def number(self, key: str, low: float, high: float) -> float:
        """A finite number within ``[low, high]``."""
        allowed = f"a number from {low:g} to {high:g}"
        value = _float(self._scalar(key, ("int", "float"), allowed))
        if not low <= value <= high:
            raise InputError(self.where(key), value, allowed)
        return value

    def integer(self, key: str, low: int, high: int) -> int:
        """A whole number within ``[low, high]``."""
        allowed = f"a whole number from {low} to {high}"
        text = self._scalar(key, ("int",), allowed)
        try:
            value = int(text.replace("_", ""), 0)
        except ValueError as error:  # YAML allows other notations: 017, 1:30
            raise InputError(self.where(key), text, allowed) from error
        if not low <= value <= high:
            raise InputError(self.where(key), value, allowed)
        return value

    def flag(self, key: str, default: bool | None = None) -> bool:
        """``true`` or ``false``; for a missing key the default, if there is one."""
        if default is not None and not self.has(key):
            return default
        return self._scalar(key, ("bool",), "true or false").lower() in {"true", "yes", "on"}

    def text(self, key: str, choices: Iterable[str] | None = None, read: Callable[[object], str] | None = None) -> str:
        """A text; with ``choices`` it must be one of them. ``read`` converts a word to its choice."""
        known = None if choices is None else tuple(choices)
        allowed = "a text that is not empty" if known is None else f"one of {', '.join(known)}"
        value = self._scalar(key, ("str",) if read is None else ("str", "int"), allowed)
        value = value if read is None else read(value)
        if not value or (known is not None and value not in known):
            raise InputError(self.where(key), value, allowed)
        return value

    def mapping(self, key: str) -> "StrictMapping":
        """A nested mapping."""
        node = self._take(key, "a mapping")
        if not isinstance(node, yaml.MappingNode):
            raise InputError(self.where(key), _shown(node), "a mapping")
        return StrictMapping(self.file, f"{self.path}.{key}" if self.path else key, node)

    def mappings(self, key: str) -> tuple["StrictMapping", ...]:
        """A list of mappings."""
        node = self._take(key, "a list of mappings")
        if not isinstance(node, yaml.SequenceNode):
            raise InputError(self.where(key), _shown(node), "a list of mappings")
        mappings = []
        for position, item in enumerate(node.value):
            if not isinstance(item, yaml.MappingNode):
                raise InputError(self.where(f"{key}[{position}]", item), _shown(item), "a mapping")
            mappings.append(StrictMapping(self.file, f"{self.path}.{key}[{position}]".lstrip("."), item))
        return tuple(mappings)

    def numbers(self, key: str, count: int, low: float, high: float, *, times: bool = False) -> tuple[float, ...]:
        """A list of ``count`` numbers within ``[low, high]``; with ``times`` of that many once or several times."""
        allowed = f"a list of {count} numbers{' or a multiple,' if times else ''} from {low:g} to {high:g}"
        node = self._take(key, allowed)
        length = len(node.value) if isinstance(node, yaml.SequenceNode) else 0
        if not isinstance(node, yaml.SequenceNode) or (length % count or not length if times else length != count):
            raise InputError(self.where(key), _shown(node), allowed)
        values = []
        for item in node.value:
            numeric = isinstance(item, yaml.ScalarNode) and item.tag in {_TAG + "int", _TAG + "float"}
            if not numeric or not low <= _float(item.value) <= high:
                raise InputError(self.where(key, item), _shown(item), allowed)
            values.append(_float(item.value))
        return tuple(values)

    def words(self, key: str) -> tuple[str, ...]:
        """A scalar or a list of scalars as texts, as written."""
        allowed = "a word, or a list of words"
        node = self._take(key, allowed)
        items = node.value if isinstance(node, yaml.SequenceNode) else [node]
        if not items or not all(isinstance(item, yaml.ScalarNode) and item.value for item in items):
            raise InputError(self.where(key), _shown(node), allowed)
        return tuple(str(item.value) for item in items)

    def finish(self) -> None:
        """Refuse keys that were not read."""
        for key, node in self.values.items():
            if key not in self._known:
                raise InputError(self.where(key, node), _shown(node), f"keys {', '.join(sorted(set(self._known)))}")


def _float(text: str) -> float:
    try:
        return float(text.replace("_", ""))
    except ValueError:  # YAML allows other notations of whole numbers: 0x1F, 0o17
        try:
            return float(int(text.replace("_", ""), 0))
        except (ValueError, OverflowError):
            return float("nan")


def _shown(node: yaml.Node) -> str:
    if isinstance(node, yaml.ScalarNode):
        return str(node.value)
    return "a list" if isinstance(node, yaml.SequenceNode) else "a mapping"


def read_input_text(file: Path) -> str:
    """Read the text of a YAML file; InputError if it cannot be read."""
    try:
        return plain_yaml.read_text(file)
    except (OSError, ValueError) as error:
        allowed = f"a readable YAML file in UTF-8 of at most {plain_yaml.MAX_BYTES} bytes"
        raise InputError(str(file), type(error).__name__, allowed) from error


def read_strict_yaml(file: Path) -> StrictMapping:
    """Read a file with ``parse_strict_yaml``; InputError also if it cannot be read."""
    return parse_strict_yaml(read_input_text(file), str(file))


def parse_strict_yaml(text: str, file: str) -> StrictMapping:
    """Parse the top-level mapping of a YAML text; errors name the file.

    Raises:
        InputError: the text is not YAML, or does not hold a mapping; names file and line.
    """
    try:
        root = plain_yaml.compose(text)
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        line = "" if mark is None else f":{mark.line + 1}"
        problem = getattr(error, "problem", None) or str(error) or "text"
        raise InputError(f"{file}{line}", problem, "valid YAML") from error
    if not isinstance(root, yaml.MappingNode):
        raise InputError(file, "no mapping" if root is None else _shown(root), "a YAML mapping at the top")
    return StrictMapping(file, "", root)
