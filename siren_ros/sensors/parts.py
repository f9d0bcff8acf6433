"""Sharing a loop out among threads."""

import itertools
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Final, TypeVar

Result = TypeVar("Result")

_THREADS: Final = 2
"""Parts of a loop: the reference machine has two cores. Fixed, so that results cannot depend on the machine."""


class Parts:
    """A range cut into equal parts, one per thread; compiled loops run without the GIL."""

    def __init__(self, count: int) -> None:
        """Cut ``range(count)``."""
        cuts = [count * part // _THREADS for part in range(_THREADS + 1)]
        self._spans = list(itertools.pairwise(cuts))
        self._helpers = ThreadPoolExecutor(_THREADS - 1, thread_name_prefix="sensor")

    def __len__(self) -> int:
        return len(self._spans)

    def run(self, work: Callable[[int, int, int], Result]) -> list[Result]:
        """Results of ``work(part, start, stop)`` for all parts, in order; the calling thread does the first part."""
        others = [self._helpers.submit(work, part, *span) for part, span in enumerate(self._spans) if part > 0]
        return [work(0, *self._spans[0]), *(other.result() for other in others)]
