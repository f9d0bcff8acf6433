"""One worker thread with a bounded queue. It keeps the order; its first error is raised in the caller."""

import queue
import threading
from collections.abc import Callable
from typing import Generic, TypeVar

T = TypeVar("T")


class BackgroundWorker(Generic[T]):
    """Calls ``work(item)`` for every item, one after the other, in a thread of its own.

    ``put`` waits while the queue is full, so that memory stays bounded. The first exception that
    ``work`` raises is raised again by the next ``put`` or by ``close``; items after it are dropped.
    """

    def __init__(self, work: Callable[[T], None], capacity: int, name: str) -> None:
        self._work = work
        self._queue: queue.Queue[tuple[T] | None] = queue.Queue(capacity)
        self._error: BaseException | None = None
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        while (entry := self._queue.get()) is not None:
            if self._error is not None:
                continue
            try:
                self._work(entry[0])
            except BaseException as error:  # noqa: BLE001 # handed over to the caller's thread
                self._error = error

    def put(self, item: T) -> None:
        """Hands an item over; raises what an earlier item raised."""
        self._raise()
        self._queue.put((item,))

    def close(self) -> None:
        """Waits until everything is done and ends the thread; raises what an item raised."""
        if self._thread.is_alive():
            self._queue.put(None)
            self._thread.join()
        self._raise()

    def _raise(self) -> None:
        if self._error is not None:
            raise self._error
