"""Exports KITTI while an episode runs. The folder is hidden until the episode is complete."""

import re
import shutil
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Final

from siren_ros.data.datasets.files import Staging
from siren_ros.errors import InputError

_JOB: Final = {"export": "of a running episode"}
"""Job that distinguishes this hidden folder from that of an unfinished ``siren export``."""
_PART: Final = 0


FRAMES_FILE: Final = "frames.csv"
FRAMES_HEAD: Final = "frame,step,timestamp\n"
_FILES: Final = re.compile(
    r"frames\.csv|objects\.csv|README\.md|ImageSets/(train|val|test|trainval)\.txt|"
    r"(training/)?(image_2|velodyne|calib|label_2|label_lidar)/\d{6,}\.(txt|bin|png|jpg)"
)
"""Matches every file of a KITTI export, in either layout."""


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


class LiveExport:
    """The folder of a running export.

    The exporter opens and closes it; the program that knows the result publishes or drops it.
    """

    def __init__(self, out: Path, *, overwrite: bool = False) -> None:
        """Prepare an export with this final folder; nothing is created yet.

        ``overwrite`` allows it to replace an earlier one.
        """
        self._out = out
        self._overwrite = overwrite
        self._staging = Staging(out)
        self._opened = ExitStack()

    def check(self) -> None:
        """Check that the final folder can be taken at the end; InputError as ``Staging.check_free``."""
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
        """Create the hidden folder, empty, and return it. Files of a killed episode are deleted.

        Raises InputError as ``check``; another episode or an unfinished ``siren export`` has the place.
        """
        self.check()
        self.drop()
        self._opened.enter_context(self._staging.opened(_JOB))
        return self._staging.new(self._staging.part(_PART))

    def close(self, *, whole: bool) -> None:
        """End the writing. A complete export waits for ``publish``; an incomplete one is deleted.

        Raises InputError: the disk does not take the note that the export is whole; it is removed.
        """
        with self._opened:
            if whole:
                self._staging.finish_part(_PART, {})

    def publish(self) -> None:
        """Rename a closed export to its final name.

        Raises InputError: the name has been taken meanwhile, or nothing was closed.
        """
        if self._replaces:
            shutil.rmtree(self._out)
        self._staging.publish(self._staging.part(_PART))

    def drop(self) -> None:
        """Delete the export of a failed episode or of a killed exporter."""
        if self._staging.path.is_dir():
            with suppress(InputError), self._staging.opened(_JOB):
                self._staging.remove()
