"""Wall time that stands still while loops are compiled in this process.

Time limits run by it: a program that compiles does not hang, and later runs have the loops from the cache.
"""

import threading
import time
from typing import Final

from numba.core import event


class _Compiling(event.Listener):
    """Adds up the time in which at least one thread compiles; what comes from the cache takes none."""

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

    def working_s(self) -> float:
        """Seconds of wall time, from any origin, without those of compilations."""
        with self._lock:
            now_s = self._began_s if self._under_way else time.monotonic()
            return now_s - self._total_s


_COMPILING: Final = _Compiling()
event.register("numba:compile", _COMPILING)  # type: ignore[no-untyped-call] # numba's own
working_s: Final = _COMPILING.working_s
