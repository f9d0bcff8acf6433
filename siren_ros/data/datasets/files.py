"""Writes the files of a dataset: in the background, staged until all are complete. It also builds XML elements.

``LiveExport`` is the folder of an export that grows while an episode runs. It is hidden until the episode is complete.
"""

import fcntl
import json
import os
import re
import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack, contextmanager, suppress
from io import BufferedWriter
from pathlib import Path
from threading import BoundedSemaphore
from types import TracebackType
from typing import Any, Final, Self
from xml.etree.ElementTree import Element, SubElement, indent, tostring

from siren_ros.base.params import plain_files
from siren_ros.errors import InputError, writing

_QUEUE_PER_THREAD: Final = 4
"""Number of files that may wait per thread; it bounds the memory for episodes of any length."""
_JOB: Final = "job.json"


class FileWriter:
    """Writes files below a folder. As a context manager, it waits for all files at its end."""

    def __init__(self, folder: Path, threads: int = 1, progress: Callable[[float], None] = lambda _: None) -> None:
        """Prepare to write into an existing folder. With one thread, ``write`` writes the file itself.

        ``progress`` is called with the simulated time in seconds that has been exported.
        """
        self.folder = folder
        self.progress = progress
        self._pool = ThreadPoolExecutor(threads, "writer") if threads > 1 else None
        self._room = BoundedSemaphore(threads * _QUEUE_PER_THREAD)
        self._failed: BaseException | None = None
        self._made: set[Path] = set()
        self._growing: dict[str, BufferedWriter] = {}

    def write(self, name: str, make: bytes | Callable[[], bytes]) -> None:
        """Write one file. ``make`` is its content, or a function that a thread calls to compute it.

        Raises InputError: this or an earlier file cannot be written.
        """
        path = self.folder / name
        if path.parent not in self._made:
            self._make_folder(path.parent)
        if self._pool is None:
            _write(path, make)
            return
        self._room.acquire()
        if self._failed is not None:
            self._room.release()
            raise self._failed
        self._pool.submit(_write, path, make).add_done_callback(self._done)

    def append(self, name: str, text: str) -> None:
        """Append text to a file at once; the file stays open."""
        path = self.folder / name
        with writing(path, "place"):
            if name not in self._growing:
                self._make_folder(path.parent)
                self._growing[name] = path.open("ab")
            self._growing[name].write(text.encode())
            self._growing[name].flush()

    def _make_folder(self, folder: Path) -> None:
        with writing(folder, "place"):
            folder.mkdir(parents=True, exist_ok=True)
        self._made.add(folder)

    def _done(self, future: "Future[None]") -> None:
        self._failed = self._failed or future.exception()
        self._room.release()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for file in self._growing.values():
            with suppress(OSError):  # the failed write has raised its error already
                file.close()
        if self._pool is not None:
            self._pool.shutdown(cancel_futures=kind is not None)
        if self._failed is not None and kind is None:
            raise self._failed


def _write(path: Path, make: bytes | Callable[[], bytes]) -> None:
    content = make if isinstance(make, bytes) else make()
    with writing(path, "place"):
        path.write_bytes(content)


class Staging:
    """The folder ``.NAME.partial`` beside the dataset's final place.

    A later attempt continues with its finished parts.
    """

    def __init__(self, out: Path) -> None:
        self.out = Path(os.path.abspath(out))  # noqa: PTH100 - an existing link is not resolved
        self.path = self.out.parent / f".{self.out.name}.partial"

    def check_free(self) -> None:
        """Check that the final place is free.

        Raises InputError: something is there already that is not an empty folder.
        """
        with writing(self.out, "place"):
            link = self.out.is_symlink()  # a rename to the final name does not follow a link
            taken = link or (self.out.exists() and (not self.out.is_dir() or any(self.out.iterdir())))
        if taken:
            raise InputError("out", str(self.out), "a folder that is new or empty")

    @contextmanager
    def opened(self, job: Mapping[str, Any]) -> Iterator[None]:
        """Create the folder, or continue with the folder of an interrupted export of the same job.

        Raises InputError: another job's unfinished export is there, somebody else writes it now, or it cannot be made.
        """
        new = not self.path.exists()
        try:
            with writing(self.path, "place"):
                self.path.mkdir(parents=True, exist_ok=True)
                with (self.path / ".lock").open("w") as file:
                    try:
                        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
                    except BlockingIOError as error:
                        raise InputError("out", str(self.out), "a folder that no other export is writing") from error
                    self._check_job(job)
                    yield
        finally:
            if new and not any(self.path.glob("parts/*.json")):
                self.remove()

    def _check_job(self, job: Mapping[str, Any]) -> None:
        text = json.dumps(job, indent=2, sort_keys=True) + "\n"
        file = self.path / _JOB
        if not file.exists():
            file.write_text(text, encoding="utf-8")
        elif file.read_text(encoding="utf-8") != text:
            allowed = f"a place without an unfinished export of other bags or options; remove {self.path} or finish it"
            raise InputError("out", str(self.out), allowed)

    def part(self, index: int) -> Path:
        """Folder of one episode's files."""
        return self.path / "parts" / f"{index:06d}"

    def report_of(self, index: int) -> dict[str, Any] | None:
        """The stored report of a finished part; None if the part is not finished."""
        file = self.part(index).with_suffix(".json")
        with suppress(OSError, ValueError):
            report: dict[str, Any] = plain_files.read_json(file)
            return report
        return None

    def finish_part(self, index: int, report: Mapping[str, Any]) -> None:
        """Store the report of a part, which marks it as finished."""
        file = self.part(index).with_suffix(".json")
        growing = file.with_suffix(".growing")
        with writing(file, "place"):
            growing.write_text(json.dumps(report), encoding="utf-8")
            growing.replace(file)

    @property
    def dataset(self) -> Path:
        """Folder of the assembled dataset."""
        return self.path / "dataset"

    def new(self, folder: Path) -> Path:
        """Empty the folder of a part or of the dataset; files of an interrupted attempt are deleted."""
        with writing(folder, "place"):
            shutil.rmtree(folder, ignore_errors=True)
            folder.mkdir(parents=True)
        return folder

    def publish(self, folder: Path) -> None:
        """Rename a folder to the final name; InputError if the name has been taken meanwhile."""
        with writing(self.out, "place"):
            folder.rename(self.out)
        self.remove()

    def remove(self) -> None:
        """Delete the hidden folder."""
        shutil.rmtree(self.path, ignore_errors=True)


def link(source: Path, target: Path) -> None:
    """Hard-link a file, or copy it where the file system has no links; an existing target stays."""
    target.parent.mkdir(parents=True, exist_ok=True)
    if target.exists():
        return
    try:
        target.hardlink_to(source)
    except (OSError, NotImplementedError):  # no links on this file system, or in this Python
        shutil.copyfile(source, target)


def link_tree(source: Path, target: Path) -> None:
    """Link all files below a folder to the same places below another folder."""
    for path in sorted(source.rglob("*")):
        if path.is_file():
            link(path, target / path.relative_to(source))
        else:
            (target / path.relative_to(source)).mkdir(parents=True, exist_ok=True)


def write_image_sets(folder: Path, sets: Mapping[str, Sequence[int]]) -> None:
    """Write ``ImageSets/NAME.txt`` with the frame numbers of each set, as KITTI and OpenPCDet expect."""
    (folder / "ImageSets").mkdir(exist_ok=True)
    for name, numbers in sets.items():
        (folder / "ImageSets" / f"{name}.txt").write_text("".join(f"{number:06d}\n" for number in numbers))


def number_text(value: float, decimals: int) -> str:
    """A number with fixed decimals, without a negative zero."""
    return f"{round(value, decimals) + 0.0:.{decimals}f}"


def child(parent: Element, path: str, text: object = None, **attributes: object) -> Element:
    """Add an element, and missing elements of its path; numbers are written with at most six decimals."""
    *above, tag = path.split("/")
    for name in above:
        parent = SubElement(parent, name)
    element = SubElement(parent, tag, {name: value_text(value) for name, value in attributes.items()})
    if text is not None:
        element.text = value_text(text)
    return element


def children(parent: Element, **texts: object) -> Element:
    """Add one element with text per tag, and return the parent."""
    for tag, text in texts.items():
        child(parent, tag, text)
    return parent


def value_text(value: Any) -> str:
    """A value as XML text."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float):
        return number_text(value, 6).rstrip("0").rstrip(".")
    return str(value)


def document(root: Element) -> bytes:
    """An XML document as bytes."""
    indent(root, " ")
    return b'<?xml version="1.0" encoding="UTF-8"?>\n' + tostring(root, encoding="utf-8") + b"\n"


_LIVE_JOB: Final = {"export": "of a running episode"}
"""Job that distinguishes this hidden folder from that of an unfinished ``siren export``."""
_LIVE_PART: Final = 0


FRAMES_FILE: Final = "frames.csv"
FRAMES_HEAD: Final = "frame,step,timestamp\n"
_KITTI_FILES: Final = re.compile(
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
    known = all(path.is_dir() or _KITTI_FILES.fullmatch(place) for path, place in paths)
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
        self._opened.enter_context(self._staging.opened(_LIVE_JOB))
        return self._staging.new(self._staging.part(_LIVE_PART))

    def close(self, *, whole: bool) -> None:
        """End the writing. A complete export waits for ``publish``; an incomplete one is deleted.

        Raises InputError: the disk does not take the note that the export is whole; it is removed.
        """
        with self._opened:
            if whole:
                self._staging.finish_part(_LIVE_PART, {})

    def publish(self) -> None:
        """Rename a closed export to its final name.

        Raises InputError: the name has been taken meanwhile, or nothing was closed.
        """
        if self._replaces:
            shutil.rmtree(self._out)
        self._staging.publish(self._staging.part(_LIVE_PART))

    def drop(self) -> None:
        """Delete the export of a failed episode or of a killed exporter."""
        if self._staging.path.is_dir():
            with suppress(InputError), self._staging.opened(_LIVE_JOB):
                self._staging.remove()
