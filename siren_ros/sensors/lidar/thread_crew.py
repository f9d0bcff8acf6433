"""Threads that share one loop: compiled loops run without the interpreter's lock, so that all cores take part."""

import os
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from typing import Final

_MOST: Final = 8
"""Beyond this the parts of a loop become too small to be worth handing out."""


class Crew:
    """The calling thread and its helpers."""

    def __init__(self, size: int) -> None:
        """Engage helpers; ``size`` counts the calling thread too."""
        self.size = max(1, size)
        self._helpers = ThreadPoolExecutor(self.size, "crew")  # makes a thread only when it is needed

    def share(self, work: Callable[[int, int, int], None], count: int, grain: int) -> None:
        """Do all of a loop, whoever is free the next part of it; returns when everything is done.

        Args:
            work: Called with the member who works (0 is the calling thread), and the first and the end index of the
                part. Parts may be done in any order and at the same time, a member's own one after the other.
            count: Length of the loop.
            grain: Length of a part; what is no longer than one part stays in the calling thread.
        """
        starts = iter(range(0, count, grain))
        members = min(self.size, -(-count // grain))
        futures = [self._helpers.submit(_work_off, work, member, starts, count, grain) for member in range(1, members)]
        try:
            _work_off(work, 0, starts, count, grain)
        finally:
            for future in futures:
                future.result()


def _work_off(
    work: Callable[[int, int, int], None], member: int, starts: Iterator[int], count: int, grain: int
) -> None:
    for first in starts:
        work(member, first, min(first + grain, count))


@cache
def everybody() -> Crew:
    """The crew of this process: a thread for each processor that it may use."""
    return Crew(min(len(os.sched_getaffinity(0)), _MOST))
