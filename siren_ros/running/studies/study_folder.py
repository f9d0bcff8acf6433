"""Storage of a study: a folder or a URL with bags, a row next to each bag, and the table of all rows."""

import hashlib
import json
import os
import shutil
from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from functools import cached_property
from importlib import import_module
from io import FileIO
from pathlib import Path
from typing import Any, Final
from uuid import uuid4

from siren_ros.base.params import plain_files
from siren_ros.base.params.folders import private_folder
from siren_ros.base.params.plain_files import sha256_of_file
from siren_ros.data.recording.bag_folder import METADATA_FILE, lock
from siren_ros.data.recording.bag_reader import storage_files
from siren_ros.errors import InputError, whole_file, writing
from siren_ros.running.studies.episode_row import EpisodeRow, Status, manifest_bytes, rows_of_manifest

MANIFEST: Final = "manifest.parquet"
STUDY: Final = "study.json"
_WORK: Final = ".work"
_OWNER: Final = ".owner"
"""File in each scratch folder whose lock is held by the process that works there."""
_held: Final[dict[Path, FileIO]] = {}
"""Locked files of this process's scratch folders."""


class StudyFolder(ABC):
    """Storage of a study; several processes may use it for different episodes."""

    @property
    @abstractmethod
    def place(self) -> str:
        """Path or URL of the folder."""

    @property
    @abstractmethod
    def scratches(self) -> Path:
        """Local folder that contains the scratch folders."""

    @abstractmethod
    def take(self, bag: Path, row: EpisodeRow) -> None:
        """Move a finished bag to its place, then write its row; each is written completely or not at all.

        Raises:
            OSError: It cannot be written.
        """

    @abstractmethod
    def hashes_of(self, path: str) -> tuple[str, str]:
        """SHA-256 of a bag's storage file and metadata, from their bytes; empty if they are missing."""

    @abstractmethod
    def read(self, name: str) -> bytes | None:
        """Read a file of the study; None if it does not exist."""

    @abstractmethod
    def write(self, name: str, content: bytes) -> None:
        """Write a file of the study; readers see either the old or the new content."""

    def scratch(self) -> Path:
        """Make a local folder for one attempt at an episode; this process holds its lock until it ends."""
        while True:
            folder = self.scratches / f"{os.getpid()}-{uuid4().hex[:12]}"
            folder.mkdir(parents=True)
            file = (folder / _OWNER).open("wb", buffering=0)
            if lock(file):
                _held[folder] = file
                return folder
            file.close()  # another process saw the folder without a lock and treated it as abandoned

    def clear_scratch(self) -> None:
        """Delete the local folders of attempts whose processes have ended; others stay."""
        for folder in sorted(self.scratches.iterdir()) if self.scratches.is_dir() else ():
            if folder not in _held:
                _remove_abandoned(folder)
        with suppress(OSError):
            self.scratches.rmdir()

    def note(self, row: EpisodeRow) -> None:
        """Write the row of an episode."""
        self.write(f"{row.path}.json", json.dumps(row.to_json(), indent=1, sort_keys=True).encode())

    def row_of(self, path: str) -> EpisodeRow | None:
        """Row next to a bag; None if there is none or it is damaged, so that the episode is made again."""
        content = self.read(f"{path}.json")
        try:
            return None if content is None else EpisodeRow.from_json(dict(plain_files.load_json(content)))
        except (InputError, ValueError, TypeError, RecursionError):
            return None


class LocalFolder(StudyFolder):
    """A study on this machine's disks."""

    def __init__(self, root: Path) -> None:
        self._root = root

    @property
    def place(self) -> str:
        """Implements ``StudyFolder.place``."""
        return str(self._root)

    @property
    def scratches(self) -> Path:
        """Implements ``StudyFolder.scratches``.

        On the same file system, so that finished bags are renamed, not copied.
        """
        return self._root / _WORK

    def take(self, bag: Path, row: EpisodeRow) -> None:
        """Implements ``StudyFolder.take``."""
        target = self._root / row.path
        target.parent.mkdir(parents=True, exist_ok=True)
        if target.exists():  # left by an attempt without a row, or a bag that was changed later
            shutil.rmtree(target)
        bag.rename(target)
        self.note(row)

    def hashes_of(self, path: str) -> tuple[str, str]:
        """Implements ``StudyFolder.hashes_of``."""
        bag = self._root / path
        return hashes_of_bag(bag) if bag.is_dir() else ("", "")

    def read(self, name: str) -> bytes | None:
        """Implements ``StudyFolder.read``."""
        try:
            return (self._root / name).read_bytes()
        except FileNotFoundError:
            return None

    def write(self, name: str, content: bytes) -> None:
        """Implements ``StudyFolder.write``."""
        target = self._root / name
        target.parent.mkdir(parents=True, exist_ok=True)
        with whole_file(target) as new:
            new.write_bytes(content)


def _remove_abandoned(folder: Path) -> None:
    try:
        with (folder / _OWNER).open("rb", buffering=0) as file:
            if lock(file):
                shutil.rmtree(folder, ignore_errors=True)
    except FileNotFoundError:  # made by a version without locks, or by a process that has not locked it yet
        owner, _, _ = folder.name.partition("-")
        if owner.isdecimal() and not Path(f"/proc/{owner}").exists():
            shutil.rmtree(folder, ignore_errors=True)
    except OSError:
        return


def hashes_of_bag(bag: Path) -> tuple[str, str]:
    """SHA-256 of a bag's storage file and metadata; empty if they are missing."""
    files = storage_files(bag)
    metadata = bag / METADATA_FILE
    return sha256_of_file(files[0]) if len(files) == 1 else "", sha256_of_file(metadata) if metadata.is_file() else ""


def is_finished(folder: StudyFolder, row: EpisodeRow) -> bool:
    """Whether an episode is complete and its bag has the bytes named in its row."""
    hashes = (row.mcap_sha256, row.metadata_sha256)
    return row.status is Status.COMPLETE and bool(row.mcap_sha256) and folder.hashes_of(row.path) == hashes


def write_table(folder: StudyFolder, rows: Iterable[EpisodeRow]) -> None:
    """Write the table of all rows."""
    folder.write(MANIFEST, manifest_bytes(rows))


def read_table(folder: StudyFolder) -> tuple[EpisodeRow, ...]:
    """Read the rows of the study's table; empty if it was not written yet."""
    content = folder.read(MANIFEST)
    return () if content is None else rows_of_manifest(content)


@contextmanager
def attempt_folder(folder: StudyFolder) -> Iterator[Path]:
    """Context with a scratch folder that is deleted at its end."""
    scratch = folder.scratch()
    try:
        yield scratch
    finally:
        shutil.rmtree(scratch, ignore_errors=True)
        if (file := _held.pop(scratch, None)) is not None:
            file.close()


def write_study(folder: StudyFolder, content: dict[str, Any]) -> None:
    """Write the study's description next to the episodes; InputError if the folder cannot be written."""
    with writing(folder.place, "folder"):
        folder.write(STUDY, json.dumps(content, indent=1, sort_keys=True).encode())


_BLOCK_BYTES: Final = 1 << 22


def folder_at(place: str) -> StudyFolder:
    """Storage of a study: a path of this machine, or a URL.

    Raises:
        InputError: A URL whose file system cannot be opened here.
    """
    if "://" not in place:
        return LocalFolder(Path(place))
    folder = RemoteFolder(place)
    try:
        folder.opened  # noqa: B018 - for its errors
    except ImportError as error:
        raise InputError("out", place, f"a folder, or a URL whose package is installed ({error})") from error
    except (OSError, ValueError) as error:
        raise InputError("out", place, f"a URL that can be opened ({error})") from error
    return folder


class RemoteFolder(StudyFolder):
    """A study behind a URL. Bags are written to the worker's own disk and uploaded when complete.

    The row of an episode is uploaded after its bag: a bag without a row is one whose upload was cut off.
    """

    def __init__(self, url: str) -> None:
        self._url = url.rstrip("/")

    def __reduce__(self) -> tuple[type["RemoteFolder"], tuple[str]]:
        """Pickle support: another process opens the file system itself."""
        return RemoteFolder, (self._url,)

    @cached_property
    def opened(self) -> tuple[Any, str]:
        """File system and place in it; raises ImportError, OSError or ValueError if it cannot be opened."""
        file_system, root = import_module("fsspec.core").url_to_fs(self._url)  # of the extra "cluster"
        return file_system, str(root)

    @property
    def place(self) -> str:
        """Implements ``StudyFolder.place``."""
        return self._url

    @property
    def scratches(self) -> Path:
        """Implements ``StudyFolder.scratches``; on this machine."""
        return private_folder(f"siren-episodes-{os.getuid()}")

    def take(self, bag: Path, row: EpisodeRow) -> None:
        """Implements ``StudyFolder.take``."""
        file_system, root = self.opened
        target = f"{root}/{row.path}"
        file_system.makedirs(target, exist_ok=True)
        for file in sorted(bag.iterdir()):
            file_system.put_file(str(file), f"{target}/{file.name}")
        self.note(row)
        shutil.rmtree(bag)

    def hashes_of(self, path: str) -> tuple[str, str]:
        """Implements ``StudyFolder.hashes_of``; the bag is read once and not stored."""
        name = path.rsplit("/", 1)[-1]
        return self._sha256(f"{path}/{name}_0.mcap"), self._sha256(f"{path}/{METADATA_FILE}")

    def _sha256(self, name: str) -> str:
        file_system, root = self.opened
        digest = hashlib.sha256()
        try:
            with file_system.open(f"{root}/{name}", "rb") as file:
                while block := file.read(_BLOCK_BYTES):
                    digest.update(block)
        except FileNotFoundError:
            return ""
        return digest.hexdigest()

    def read(self, name: str) -> bytes | None:
        """Implements ``StudyFolder.read``."""
        file_system, root = self.opened
        try:
            return bytes(file_system.cat_file(f"{root}/{name}"))
        except FileNotFoundError:
            return None

    def write(self, name: str, content: bytes) -> None:
        """Implements ``StudyFolder.write``; object stores replace an object as a whole."""
        file_system, root = self.opened
        target = f"{root}/{name}"
        file_system.makedirs(target.rsplit("/", 1)[0], exist_ok=True)
        file_system.pipe_file(target, content)
