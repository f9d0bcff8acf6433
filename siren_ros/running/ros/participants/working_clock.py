"""Wall time that stops while this process compiles loops.

Time limits run by it: a program that compiles does not hang, and later runs have the loops from the cache.
"""

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Final

from numba.core import event


class _Compilations(event.Listener):
    """Compilations in progress in any thread, and their total time; cached loops do not count."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._under_way = 0
        self._began_s = 0.0
        self._total_s = 0.0

    def on_start(self, _: event.Event) -> None:
        with self._lock:
            if self._under_way == 0:
                self._began_s = time.monotonic()
            self._under_way += 1

    def on_end(self, _: event.Event) -> None:
        with self._lock:
            self._under_way -= 1
            if self._under_way == 0:
                self._total_s += time.monotonic() - self._began_s

    def is_compiling(self) -> bool:
        """Whether any thread of this process is compiling a loop."""
        return self._under_way > 0

    def working_s(self) -> float:
        """Seconds of wall time from an arbitrary origin, without compilations."""
        with self._lock:
            now_s = self._began_s if self._under_way else time.monotonic()
            return now_s - self._total_s


_COMPILATIONS: Final = _Compilations()
event.register("numba:compile", _COMPILATIONS)  # type: ignore[no-untyped-call] # numba's own
is_compiling: Final = _COMPILATIONS.is_compiling
working_s: Final = _COMPILATIONS.working_s
ANNOUNCE_S: Final = 1.0


@contextmanager
def announcing(announce: Callable[[], None]) -> Iterator[None]:
    """Call ``announce`` every second while a loop is compiled, in a separate thread.

    The lockstep runs in another process, whose clock does not stand still meanwhile.
    """
    ended = threading.Event()

    def run() -> None:
        while not ended.wait(ANNOUNCE_S):
            if is_compiling():
                announce()

    thread = threading.Thread(target=run, name="compiling", daemon=True)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()
