"""The KITTI folder of a running episode: hidden while it grows, under its own name when the episode is complete."""

import re
import shutil
from contextlib import ExitStack, suppress
from enum import StrEnum
from pathlib import Path
from typing import Final

from siren_ros.data.datasets.files import Staging
from siren_ros.errors import InputError

_JOB: Final = {"export": "of a running episode"}
"""Tells its hidden folder from that of an unfinished ``siren export``, which the same command finishes."""
_PART: Final = 0


FRAMES_FILE: Final = "frames.csv"
FRAMES_HEAD: Final = "frame,step,timestamp\n"
_FILES: Final = re.compile(
    r"frames\.csv|objects\.csv|README\.md|ImageSets/(train|val|test|trainval)\.txt|"
    r"(training/)?(image_2|velodyne|calib|label_2|label_lidar)/\d{6,}\.(txt|bin|png|jpg)"
)
"""Every file of an export, in either layout."""


def is_kitti_export(folder: Path) -> bool:
    """Whether a folder holds the KITTI export of a running episode, and no other file."""
    try:
        with (folder / FRAMES_FILE).open(encoding="utf-8") as table:
            begins = table.readline() == FRAMES_HEAD
    except (OSError, ValueError):
        return False
    paths = [(path, path.relative_to(folder).as_posix()) for path in folder.rglob("*")]
    known = all(path.is_dir() or _FILES.fullmatch(place) for path, place in paths)
    return begins and known and not any(path.is_symlink() for path in (folder, *(path for path, _ in paths)))


class Layout(StrEnum):
    """Which layout."""

    KITTI = "kitti"
    """The object benchmark's own."""
    PAPER = "paper"


class LiveExport:
    """The exporter opens and closes it; the program that knows how the episode ended publishes or drops it."""

    def __init__(self, out: Path, *, overwrite: bool = False) -> None:
        """An export with this final folder, which may replace an earlier one there; nothing is made yet."""
        self._out = out
        self._overwrite = overwrite
        self._staging = Staging(out)
        self._opened = ExitStack()

    def check(self) -> None:
        """Refuses a final folder that could not be taken at the end; InputError as ``Staging.check_free``."""
        if self._replaces:
            return
        if is_kitti_export(self._out):
            allowed = "a folder that is new or empty; overwrite (overwrite:=true) replaces this export"
            raise InputError("out", str(self._out), allowed)
        self._staging.check_free()

    @property
    def _replaces(self) -> bool:
        return self._overwrite and is_kitti_export(self._out)

    def open(self) -> Path:
        """The folder to write into, new and empty. What a killed episode left in its place goes away.

        Raises InputError as ``check``; another episode or an unfinished ``siren export`` has the place.
        """
        self.check()
        self.drop()
        self._opened.enter_context(self._staging.opened(_JOB))
        return self._staging.new(self._staging.part(_PART))

    def close(self, *, whole: bool) -> None:
        """Ends the writing. A whole export stays for ``publish``, another one is removed.

        Raises InputError: the disk does not take the note that the export is whole; it is removed.
        """
        with self._opened:
            if whole:
                self._staging.finish_part(_PART, {})

    def publish(self) -> None:
        """Gives a closed export its final name.

        Raises InputError: the name has been taken meanwhile, or nothing was closed.
        """
        if self._replaces:
            shutil.rmtree(self._out)
        self._staging.publish(self._staging.part(_PART))

    def drop(self) -> None:
        """Removes what an exporter left that is gone: closed, but of an episode that failed later, or killed."""
        if self._staging.path.is_dir():
            with suppress(InputError), self._staging.opened(_JOB):
                self._staging.remove()
