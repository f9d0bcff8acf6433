"""Independent tasks at the same time, in threads that wait for other processes or for servers."""

from collections.abc import Callable, Mapping
from concurrent.futures import FIRST_EXCEPTION, ThreadPoolExecutor, wait
from typing import TypeVar

Result = TypeVar("Result")


def side_by_side(tasks: Mapping[str, Callable[[], Result]], workers: int) -> dict[str, Result]:
    """The results of all tasks, by name. The first error ends those that have not begun, and is raised.

    Args:
        tasks: By name. They run in threads.
        workers: How many at once.
    """
    with ThreadPoolExecutor(workers, "task") as pool:
        futures = {name: pool.submit(task) for name, task in tasks.items()}
        try:
            done, _ = wait(futures.values(), return_when=FIRST_EXCEPTION)
            for future in done:
                future.result()
        finally:
            for future in futures.values():
                future.cancel()
        return {name: future.result() for name, future in futures.items()}
