"""Functions run side by side in processes, which tell how far they are."""

import multiprocessing
import signal
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import contextmanager
from multiprocessing.queues import SimpleQueue
from threading import Thread
from typing import Any, Final

Progress = Callable[[float], None]
"""Told how many seconds of simulated time have been exported since the last call."""
_NOTICE_S: Final = 0.5
_queue: "SimpleQueue[float | None] | None" = None
_local: Progress | None = None


def _start_worker(queue: "SimpleQueue[float | None]") -> None:
    global _queue  # noqa: PLW0603 - how a process of a pool is given what it needs
    _queue = queue
    # The program that was interrupted ends its workers itself.
    signal.signal(signal.SIGINT, signal.SIG_IGN)


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
    context = multiprocessing.get_context("spawn")
    queue: SimpleQueue[float | None] = context.SimpleQueue()

    def listen() -> None:
        while (step := queue.get()) is not None:
            progress(step)

    listener = Thread(target=listen, daemon=True)
    listener.start()
    pool = ProcessPoolExecutor(processes, context, _start_worker, (queue,))

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
