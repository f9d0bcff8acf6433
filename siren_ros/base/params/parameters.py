"""Parameters: fields of dataclasses, and YAML files with checks that name file, line, key, value and what is allowed.

YAML comes from untrusted sources: no tags that build objects, no aliases, limited size and depth. An episode's files
come from the disk, or from the record of an earlier one.
"""

import dataclasses
import hashlib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, Final, Protocol

import yaml

from siren_ros.base.params.folders import named_params_file
from siren_ros.errors import BagError, InputError

Value = bool | int | float | str | list[str]


def parameter(
    default: Any,
    description: str,
    *,
    minimum: float | None = None,
    maximum: float | None = None,
    choices: Sequence[str] = (),
    read: Callable[[object], str] | None = None,
) -> Any:
    """Define a dataclass field whose metadata contain what users must know to set it.

    A default that is a list is copied for every instance. ``choices`` are all allowed values, if they can be counted;
    ``read`` gives the choice that a word of the user stands for.
    """
    metadata = {
        "description": description,
        "minimum": minimum,
        "maximum": maximum,
        "choices": tuple(choices),
        "read": read,
    }
    if isinstance(default, list):
        return dataclasses.field(default_factory=lambda: list(default), metadata=metadata)
    return dataclasses.field(default=default, metadata=metadata)


def defaults_of(config_type: type[Any]) -> dict[str, Value]:
    """Defaults of all parameters of a config dataclass, by name."""
    config = config_type()
    return {field.name: getattr(config, field.name) for field in dataclasses.fields(config_type)}


def allowed_text(field: "dataclasses.Field[Any]", kind: type) -> str:
    """Text that says what a parameter accepts."""
    low, high, choices = (field.metadata.get(key) for key in ("minimum", "maximum", "choices"))
    if choices:
        return "one of " + ", ".join(repr(choice) for choice in choices)
    names = {bool: "true or false", int: "an integer", float: "a number", str: "a string", list: "a list of strings"}
    name = names[kind]
    if low is not None and high is not None:
        return f"{name} from {low:.12g} to {high:.12g}"
    if low is not None:
        return f"{name} of at least {low:g}"
    return name


def checked_value(field: "dataclasses.Field[Any]", default: Value, value: Any) -> Value:
    """Convert a value to the default's type.

    InputError for a wrong type, a number out of range, or an unknown choice.
    """
    kind = type(default)
    allowed = allowed_text(field, kind)
    if read := field.metadata.get("read"):
        value = read(value)
    if kind is float and isinstance(value, int) and not isinstance(value, bool):
        value = float(value)
    if kind is str and not isinstance(value, str) and isinstance(value, (int, float, bool)):
        raise InputError(field.name, value, allowed)
    if kind is list and (value is None or isinstance(value, (list, tuple))):
        value = [str(item) for item in value or ()]  # ROS reads an empty list in a parameter file as None
    if type(value) is not kind:
        raise InputError(field.name, value, allowed)
    low, high, choices = (field.metadata.get(key) for key in ("minimum", "maximum", "choices"))
    if isinstance(value, (int, float)) and not isinstance(value, bool):
        too_low = low is not None and value < low
        too_high = high is not None and value > high
        if too_low or too_high or value != value:  # noqa: PLR0124 - NaN is the only value that differs from itself
            raise InputError(field.name, value, allowed)
    if choices and value not in choices:
        raise InputError(field.name, value, allowed)
    return value


def check_fields(config: Any) -> None:
    """Check every field of a dataclass of parameters; InputError as ``checked_value``."""
    defaults = type(config)()
    for field in dataclasses.fields(config):
        checked_value(field, getattr(defaults, field.name), getattr(config, field.name))


MAX_YAML_BYTES: Final = 256_000
"""Largest file that is read; our largest has 5 kB."""
MAX_YAML_DEPTH: Final = 32
_LOADER: Final = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
"""PyYAML's safe loader, in C if the wheel has it."""


def read_yaml_text(file: Path) -> str:
    """Read the text of a YAML file.

    Raises:
        OSError: It cannot be read, or is no file.
        ValueError: It is not UTF-8, too large, or its path is none.
    """
    if file.exists() and not file.is_file():
        raise OSError(f"{file} is no file")
    with file.open("rb") as stream:
        data = stream.read(MAX_YAML_BYTES + 1)
    if len(data) > MAX_YAML_BYTES:
        raise ValueError(f"more than {MAX_YAML_BYTES} bytes")
    return data.decode("utf-8")


@lru_cache(maxsize=64)
def compose_yaml(text: str) -> yaml.Node | None:
    """Parse a document to YAML nodes; yaml.YAMLError if it is invalid.

    The same text is parsed once in a process, however many parts of an episode read it. Readers leave the nodes as
    they are.
    """
    node: yaml.Node | None = _guarded(lambda: yaml.compose(text, Loader=_LOADER), text)
    return node


def load_yaml(text: str) -> Any:
    """Parse a document to mappings, lists, texts, numbers, dates; yaml.YAMLError if it is invalid."""
    return _guarded(lambda: yaml.load(text, Loader=_LOADER), text)  # noqa: S506 - a safe loader


def yaml_fault(error: yaml.YAMLError) -> str:
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
            if depth > MAX_YAML_DEPTH:
                raise yaml.YAMLError(f"more than {MAX_YAML_DEPTH} levels")
        return action()
    except (ValueError, TypeError, LookupError, AttributeError, OverflowError, RecursionError) as error:
        # PyYAML does not convert all errors of its value conversions, for example of the date 2001-99-99.
        raise yaml.YAMLError(f"a value that cannot be read ({error})") from error


_TAG = "tag:yaml.org,2002:"


@dataclass
class StrictMapping:
    """A YAML mapping in which every key must be read.

    Each reader method removes the key from what is left; ``finish`` refuses the rest as unknown.
    """

    file: str
    path: str
    node: yaml.MappingNode
    values: dict[str, yaml.Node] = dataclasses.field(init=False)
    _known: list[str] = dataclasses.field(init=False, default_factory=list)

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
        text = self._scalar(key, ("int", "float"), allowed)
        value = _float(text)
        if not low <= value <= high:
            raise InputError(self.where(key), text if value != value else value, allowed)  # noqa: PLR0124 - NaN
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
        return read_yaml_text(file)
    except (OSError, ValueError) as error:
        allowed = f"a readable YAML file in UTF-8 of at most {MAX_YAML_BYTES} bytes"
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
        root = compose_yaml(text)
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        line = "" if mark is None else f":{mark.line + 1}"
        problem = getattr(error, "problem", None) or str(error) or "text"
        raise InputError(f"{file}{line}", problem, "valid YAML") from error
    if not isinstance(root, yaml.MappingNode):
        raise InputError(file, "no mapping" if root is None else _shown(root), "a YAML mapping at the top")
    return StrictMapping(file, "", root)


@dataclass(frozen=True)
class InputFile:
    """One parameter file as read."""

    folder: str
    """Folder below ``params``, which is the kind of the file: ``templates``, ``presets``, …"""
    name: str
    """The user's name for the file: ``S2``, or a path."""
    text: str
    source: str = dataclasses.field(default="", compare=False)
    """Path for error messages."""

    @property
    def sha256(self) -> str:
        """Hash of the text in UTF-8."""
        return sha256_of(self.text)

    def mapping(self) -> StrictMapping:
        """The file's YAML mapping; InputError with the line if it is not one."""
        return parse_strict_yaml(self.text, self.source or self.name)


class InputFiles(Protocol):
    """A source of parameter files."""

    def read(self, parameter: str, folder: str, name: str) -> InputFile:
        """Read a file by its name in a folder below ``params``, or by the path of a YAML file.

        Raises:
            InputError: There is no such file, or it cannot be read; names the parameter that the user set.
        """

    def has(self, folder: str, name: str) -> bool:
        """Whether the source should have a file; on disk all files of the program exist."""


class FilesOnDisk:
    """The files of ``params`` and of the user."""

    def read(self, parameter: str, folder: str, name: str) -> InputFile:
        """Implements ``InputFiles.read``."""
        path = named_params_file(parameter, folder, name)
        return InputFile(folder, name, read_input_text(path), str(path))

    def has(self, folder: str, name: str) -> bool:  # noqa: ARG002 - part of the interface of all sources
        """Implements ``InputFiles.has``."""
        return True


FILES_ON_DISK: Final = FilesOnDisk()


class RecordedFiles:
    """The parameter files in an episode's record."""

    def __init__(self, files: Iterable[InputFile]) -> None:
        self._files = {(file.folder, file.name): file for file in files}

    def read(self, parameter: str, folder: str, name: str) -> InputFile:
        """Implements ``InputFiles.read``."""
        file = self._files.get((folder, name))
        if file is None:
            known = ", ".join(sorted(f"{kind}/{known}" for kind, known in self._files))
            raise InputError(parameter, name, f"a file of the record: {known}")
        return file

    def has(self, folder: str, name: str) -> bool:
        """Implements ``InputFiles.has``."""
        return (folder, name) in self._files


class NotedFiles:
    """Wraps another source and remembers each file that is read."""

    def __init__(self, source: InputFiles) -> None:
        self._source = source
        self._seen: dict[tuple[str, str], InputFile] = {}

    def read(self, parameter: str, folder: str, name: str) -> InputFile:
        """Implements ``InputFiles.read``."""
        file = self._source.read(parameter, folder, name)
        self._seen[folder, name] = file
        return file

    def has(self, folder: str, name: str) -> bool:
        """Implements ``InputFiles.has``."""
        return self._source.has(folder, name)

    @property
    def seen(self) -> tuple[InputFile, ...]:
        """The files read so far, by folder and name."""
        return tuple(self._seen[key] for key in sorted(self._seen))


def sha256_of(text: str) -> str:
    """SHA-256 of a text in UTF-8, as hexadecimal digits."""
    return hashlib.sha256(text.encode()).hexdigest()


def files_to_json(files: Iterable[InputFile]) -> list[dict[str, str]]:
    """The files as JSON types, with their hashes."""
    return [{"folder": file.folder, "name": file.name, "sha256": file.sha256, "text": file.text} for file in files]


def files_from_json(stored: Any) -> tuple[InputFile, ...]:
    """Inverse of ``files_to_json``; BagError for an entry that is incomplete, too large, or does not match its hash."""
    if not isinstance(stored, list):
        raise BagError("files of the episode", "a list")
    return tuple(_file_from_json(entry) for entry in stored)


def _file_from_json(entry: Any) -> InputFile:
    keys = ("folder", "name", "sha256", "text")
    if not isinstance(entry, Mapping) or not all(isinstance(entry.get(key), str) for key in keys):
        raise BagError("files of the episode", f"entries with the texts {', '.join(keys)}")
    folder, name, sha256, text = (str(entry[key]) for key in keys)
    shown = f"{folder}/{name}"
    if len(text) > MAX_YAML_BYTES:
        raise BagError(shown, f"a recorded file of at most {MAX_YAML_BYTES} bytes")
    if sha256_of(text) != sha256:
        raise BagError(shown, f"a recorded file with its SHA-256, {sha256}")
    return InputFile(folder, name, text, f"{name} of the record")
