"""Threads that share one loop: compiled loops run without the interpreter's lock, so that all cores take part."""

import os
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from typing import Final

_MOST: Final = 8
"""With more threads the parts of a loop become too small to gain anything."""


class ThreadPool:
    """The calling thread and further threads, which share loops."""

    def __init__(self, size: int) -> None:
        """Prepare the threads; ``size`` counts the calling thread too."""
        self.size = max(1, size)
        self._executor = ThreadPoolExecutor(self.size, "rays")  # makes a thread only when it is needed

    def run(self, work: Callable[[int, int, int], None], count: int, grain: int) -> None:
        """Run a loop in parts: a thread that is free takes the next part. Returns when all parts are done.

        Args:
            work: Called with the number of the thread (0 is the calling one) and the first and the end index of a part.
                Parts run in any order and at the same time; those of one thread run one after the other.
            count: Length of the loop.
            grain: Length of a part; a loop of one part stays in the calling thread.
        """
        starts = iter(range(0, count, grain))
        workers = min(self.size, -(-count // grain))
        futures = [
            self._executor.submit(_take_parts, work, worker, starts, count, grain) for worker in range(1, workers)
        ]
        try:
            _take_parts(work, 0, starts, count, grain)
        finally:
            for future in futures:
                future.result()


def _take_parts(
    work: Callable[[int, int, int], None], worker: int, starts: Iterator[int], count: int, grain: int
) -> None:
    for first in starts:
        work(worker, first, min(first + grain, count))


@cache
def shared_pool() -> ThreadPool:
    """The pool of this process: a thread for each processor that it may use."""
    return ThreadPool(min(len(os.sched_getaffinity(0)), _MOST))
