"""The same measurement on many bags, in several processes, with a bar; a bag that cannot be read keeps none back."""

import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TypeVar

from tqdm import tqdm

from siren_ros.datasets.exporting.worker_pool import worker_pool
from siren_ros.errors import EXIT_OK, SirenError

Found = TypeVar("Found")


def of_each_bag(measure: Callable[[Path], Found], bags: Sequence[Path], jobs: int) -> tuple[list[Found], int]:
    """What was measured on the bags that can be read, and the worst exit code; standard error says what is wrong.

    Args:
        measure: A function of a module, because other processes call it.
        bags: In the order in which they are begun.
        jobs: Processes at once.
    """
    worst, results = EXIT_OK, []
    with (
        worker_pool(min(jobs, len(bags)), lambda _: None) as pool,
        tqdm(total=len(bags), unit="episode", desc="evaluate", disable=None) as bar,
    ):
        for _, (found, error) in pool(_tried, [(measure, bag) for bag in bags]):
            bar.update(1)
            if error is None:
                results.append(found)
            else:
                print(f"siren evaluate: {error}", file=sys.stderr)
                worst = max(worst, error.exit_code)
    return results, worst


def _tried(measure: Callable[[Path], Found], bag: Path) -> tuple[Found, None] | tuple[None, SirenError]:
    try:
        return measure(bag), None
    except SirenError as error:
        return None, error
