"""Runs work on many items at the same time: futures in the order of completion, and tasks in threads."""

from collections.abc import Callable, Generator, Iterable, Mapping
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from itertools import islice
from typing import Final, TypeVar

Item = TypeVar("Item")
Result = TypeVar("Result")
_LOOK_S: Final = 0.5


def as_ready(
    submit: Callable[[Item], Future[Result]],
    items: Iterable[Item],
    at_once: int,
    look: Callable[[], None] = lambda: None,
) -> Generator[tuple[Item, Future[Result]], None, None]:
    """Yield items with their finished futures, in the order of completion. Closing the generator cancels running work.

    ``submit`` begins the work on an item, which is taken when its turn comes, so that there may be very many. ``look``
    is called twice a second while the work goes on.
    """
    waiting = iter(items)
    running: dict[Future[Result], Item] = {}
    try:
        while True:
            for item in islice(waiting, at_once - len(running)):
                running[submit(item)] = item
            if not running:
                return
            done, _ = wait(running, _LOOK_S, return_when=FIRST_COMPLETED)
            look()
            for future in done:
                yield running.pop(future), future
    finally:
        for future in running:
            future.cancel()


def side_by_side(
    tasks: Mapping[Item, Callable[[], Result]], workers: int, stop: Callable[[], None] = lambda: None
) -> dict[Item, Result]:
    """Run independent tasks in parallel; results by their keys. The first error cancels waiting tasks and is raised.

    The tasks run in threads, where they wait for processes or for servers. After an error ``stop`` ends what they wait
    for, before they are awaited.
    """
    with ThreadPoolExecutor(workers, "task") as threads:
        try:
            finished = as_ready(lambda name: threads.submit(tasks[name]), tasks, workers)
            results = {name: future.result() for name, future in finished}
        except BaseException:
            threads.shutdown(wait=False, cancel_futures=True)
            stop()
            raise
    return {name: results[name] for name in tasks}
