"""Functions run at the same time in processes of a pool, which report how far they are."""

import ctypes
import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import contextmanager
from multiprocessing.queues import SimpleQueue
from typing import Any, Final

Progress = Callable[[float], None]
"""Told how many seconds of simulated time have been exported since the last call."""
_NOTICE_S: Final = 0.5
_queue: "SimpleQueue[float | None] | None" = None
_local: Progress | None = None


_END_WITH_PARENT: Final = 1
"""``PR_SET_PDEATHSIG`` of Linux's ``prctl``."""


def _start_worker(queue: "SimpleQueue[float | None]", parent: int) -> None:
    global _queue  # noqa: PLW0603 - how a process of a pool is given what it needs
    _queue = queue
    # The program that was interrupted ends its workers itself.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    if sys.platform == "linux":
        # A forked worker holds the writing end of its own queue, and would wait for ever after the program was killed.
        ctypes.CDLL(None).prctl(_END_WITH_PARENT, signal.SIGKILL)
        if os.getppid() != parent:
            os.kill(os.getpid(), signal.SIGKILL)


def _start_method() -> str:
    """``fork`` where that is sound: no other Python thread can hold a lock that the copy would wait for.

    A forked worker has all modules at once; a spawned one loads them first, which takes half as long as the export of
    a short episode.
    """
    return "fork" if sys.platform == "linux" and threading.active_count() == 1 else "spawn"


def _ready() -> None:
    """Asked of each worker so that it starts."""


def simulated_time() -> Progress:
    """Takes the simulated time that has been reached, and passes on steps of it."""
    reached = 0.0

    def told(time_s: float) -> None:
        nonlocal reached
        if time_s - reached < _NOTICE_S:
            return
        if _queue is not None:
            _queue.put(time_s - reached)
        elif _local is not None:
            _local(time_s - reached)
        reached = time_s

    return told


Run = Callable[[Callable[..., Any], Iterable[tuple[Any, ...]]], Iterator[tuple[int, Any]]]


@contextmanager
def worker_pool(processes: int, progress: Progress) -> Iterator[Run]:
    """Runs a function over many arguments, here or in processes; gives (number of the call, what it returned)."""
    if processes <= 1:
        global _local  # noqa: PLW0603 - the same in this process
        _local = progress
        yield lambda function, calls: ((number, function(*call)) for number, call in enumerate(calls))
        return
    context = multiprocessing.get_context(_start_method())
    queue: SimpleQueue[float | None] = context.SimpleQueue()

    def listen() -> None:
        while (step := queue.get()) is not None:
            progress(step)

    listener = threading.Thread(target=listen, daemon=True)
    pool = ProcessPoolExecutor(processes, context, _start_worker, (queue, os.getpid()))
    pool.submit(_ready)  # forked workers all start here, before this process has threads
    listener.start()

    def run(function: Callable[..., Any], calls: Iterable[tuple[Any, ...]]) -> Iterator[tuple[int, Any]]:
        futures = {pool.submit(function, *call): number for number, call in enumerate(calls)}
        for future in as_completed(futures):
            yield futures[future], future.result()

    try:
        yield run
    except BaseException:
        pool.shutdown(wait=False, cancel_futures=True)
        for child in multiprocessing.active_children():
            child.terminate()
        raise
    finally:
        pool.shutdown()
        queue.put(None)
        listener.join()
