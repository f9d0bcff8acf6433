"""A study behind a URL that fsspec knows: object stores such as S3, and all other file systems it has."""

import hashlib
import json
import os
import shutil
import tempfile
from functools import cached_property
from importlib import import_module
from pathlib import Path
from typing import Any, Final

from siren_ros.errors import InputError
from siren_ros.recording.bag_metadata import METADATA_FILE
from siren_ros.studies.episode_row import EpisodeRow
from siren_ros.studies.study_folder import LocalFolder, StudyFolder, clear_scratch_in, new_scratch, row_in

_BLOCK_BYTES: Final = 1 << 22


def folder_at(place: str) -> StudyFolder:
    """The folder of a study: a path of this machine, or a URL.

    Raises:
        InputError: A URL whose file system cannot be opened here.
    """
    if "://" not in place:
        return LocalFolder(Path(place))
    folder = RemoteFolder(place)
    try:
        folder.check()
    except ImportError as error:
        raise InputError("out", place, f"a folder, or a URL whose package is installed ({error})") from error
    except (OSError, ValueError) as error:
        raise InputError("out", place, f"a URL that can be opened ({error})") from error
    return folder


class RemoteFolder:
    """A study behind a URL. Bags are written on the worker's own disk and uploaded when they are whole.

    The row of an episode is uploaded after its bag: a bag without a row is one whose upload was cut off.
    """

    def __init__(self, url: str) -> None:
        self._url = url.rstrip("/")

    def __reduce__(self) -> tuple[type["RemoteFolder"], tuple[str]]:
        """Another process opens the file system itself."""
        return RemoteFolder, (self._url,)

    @cached_property
    def _opened(self) -> tuple[Any, str]:
        file_system, root = import_module("fsspec.core").url_to_fs(self._url)  # of the extra "cluster"
        return file_system, str(root)

    def check(self) -> None:
        """Open the file system; raises ImportError, OSError or ValueError where that fails."""
        self._opened  # noqa: B018 - for its errors

    @property
    def place(self) -> str:
        """As ``StudyFolder``."""
        return self._url

    def scratch(self) -> Path:
        """As ``StudyFolder``."""
        return new_scratch(self._scratches())

    def clear_scratch(self) -> None:
        """As ``StudyFolder``."""
        clear_scratch_in(self._scratches())

    @staticmethod
    def _scratches() -> Path:
        return Path(tempfile.gettempdir()) / f"siren-episodes-{os.getuid()}"

    def take(self, bag: Path, row: EpisodeRow) -> None:
        """As ``StudyFolder``."""
        file_system, root = self._opened
        target = f"{root}/{row.path}"
        file_system.makedirs(target, exist_ok=True)
        for file in sorted(bag.iterdir()):
            file_system.put_file(str(file), f"{target}/{file.name}")
        self.note(row)
        shutil.rmtree(bag)

    def note(self, row: EpisodeRow) -> None:
        """As ``StudyFolder``."""
        self.write(f"{row.path}.json", json.dumps(row.to_json(), indent=1, sort_keys=True).encode())

    def row_of(self, path: str) -> EpisodeRow | None:
        """As ``StudyFolder``."""
        return row_in(self.read(f"{path}.json"))

    def hashes_of(self, path: str) -> tuple[str, str]:
        """As ``StudyFolder``: the bag is read once and not kept."""
        name = path.rsplit("/", 1)[-1]
        return self._sha256(f"{path}/{name}_0.mcap"), self._sha256(f"{path}/{METADATA_FILE}")

    def _sha256(self, name: str) -> str:
        file_system, root = self._opened
        digest = hashlib.sha256()
        try:
            with file_system.open(f"{root}/{name}", "rb") as file:
                while block := file.read(_BLOCK_BYTES):
                    digest.update(block)
        except FileNotFoundError:
            return ""
        return digest.hexdigest()

    def read(self, name: str) -> bytes | None:
        """As ``StudyFolder``."""
        file_system, root = self._opened
        try:
            return bytes(file_system.cat_file(f"{root}/{name}"))
        except FileNotFoundError:
            return None

    def write(self, name: str, content: bytes) -> None:
        """As ``StudyFolder``: object stores replace a whole object at once."""
        file_system, root = self._opened
        target = f"{root}/{name}"
        file_system.makedirs(target.rsplit("/", 1)[0], exist_ok=True)
        file_system.pipe_file(target, content)
