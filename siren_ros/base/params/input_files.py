"""Sources of an episode's parameter files: the disk for a new episode, or the record of an earlier one."""

import hashlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, Final, Protocol

from siren_ros.base.params import plain_yaml
from siren_ros.base.params.resources import named_params_file
from siren_ros.base.params.strict_yaml import StrictMapping, parse_strict_yaml, read_input_text
from siren_ros.errors import BagError, InputError


@dataclass(frozen=True)
class InputFile:
    """One parameter file as read."""

    folder: str
    """Folder below ``params``, which is the kind of the file: ``templates``, ``presets``, …"""
    name: str
    """The user's name for the file: ``S2``, or a path."""
    text: str
    source: str = field(default="", compare=False)
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
    if len(text) > plain_yaml.MAX_BYTES:
        raise BagError(shown, f"a recorded file of at most {plain_yaml.MAX_BYTES} bytes")
    if sha256_of(text) != sha256:
        raise BagError(shown, f"a recorded file with its SHA-256, {sha256}")
    return InputFile(folder, name, text, f"{name} of the record")
