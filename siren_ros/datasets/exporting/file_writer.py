"""Writes the files of an export, in several threads where there are processors for it."""

from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from io import BufferedWriter
from pathlib import Path
from threading import BoundedSemaphore
from types import TracebackType
from typing import Final, Self

from siren_ros.errors import writing

_QUEUE_PER_THREAD: Final = 4
"""Files that may wait for a thread: bounds the memory, however long the episode."""


class FileWriter:
    """Writes files below a folder. Use it as a context: leaving it waits for all files."""

    def __init__(self, folder: Path, threads: int = 1, progress: Callable[[float], None] = lambda _: None) -> None:
        """A writer of the files of one episode.

        Args:
            folder: Exists already.
            threads: With one, files are written where ``write`` is called.
            progress: Told the simulated time in seconds that has been exported.
        """
        self.folder = folder
        self.progress = progress
        self._pool = ThreadPoolExecutor(threads, "writer") if threads > 1 else None
        self._room = BoundedSemaphore(threads * _QUEUE_PER_THREAD)
        self._failed: BaseException | None = None
        self._made: set[Path] = set()
        self._growing: dict[str, BufferedWriter] = {}

    def write(self, name: str, make: bytes | Callable[[], bytes]) -> None:
        """Writes one file; ``make`` gives its content where that costs time, and is called in a thread.

        Raises:
            InputError: This or an earlier file cannot be written.
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
        """Adds text to the end of a file, at once; the file stays open for more."""
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
            with suppress(OSError):  # what a full disk did not take has been told where it was written
                file.close()
        if self._pool is not None:
            self._pool.shutdown(cancel_futures=kind is not None)
        if self._failed is not None and kind is None:
            raise self._failed


def _write(path: Path, make: bytes | Callable[[], bytes]) -> None:
    content = make if isinstance(make, bytes) else make()
    with writing(path, "place"):
        path.write_bytes(content)
