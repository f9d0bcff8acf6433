"""Files of training data: each is made in a separate process and kept for later runs."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Final, Generic, Protocol, TypeVar

import numpy as np

from siren_ros.base.params import plain_files
from siren_ros.base.processes.process_pool import side_by_side
from siren_ros.errors import InputError, SirenError, whole_file
from siren_ros.running.studies.run_study import attempt_processes


class Named(Protocol):
    """Protocol of an item of a plan."""

    @property
    def name(self) -> str:
        """Unique name of the item."""


Planned = TypeVar("Planned", bound=Named)
_RETRIES: Final = 2


@dataclass(frozen=True)
class MadeFiles(Generic[Planned]):
    """Result of a plan."""

    files: tuple[tuple[Planned, Path], ...]
    missing: tuple[tuple[Planned, str], ...]
    """Items without a file, with the reason: a map without a site, a failed episode."""


def make_files(
    paths: Mapping[Planned, Path], make: Callable[[Planned, Path], None], jobs: int, done: Callable[[], None]
) -> MadeFiles[Planned]:
    """Make the missing files, several in parallel.

    ``make`` is a function of a module, because it runs in other processes. ``done`` is called after each file, also of
    those that are there.
    """
    reasons: dict[Planned, str] = {}
    with attempt_processes(jobs) as pool:

        def make_file(planned: Planned, path: Path) -> None:
            try:
                if not path.exists():
                    pool.call_with_retries(_RETRIES, make, planned, path)
            except SirenError as error:
                reasons[planned] = str(error)
            finally:
                done()

        side_by_side({planned: partial(make_file, planned, path) for planned, path in paths.items()}, jobs, pool.stop)
    return MadeFiles(
        tuple((planned, path) for planned, path in paths.items() if planned not in reasons),
        tuple((planned, reasons[planned]) for planned in paths if planned in reasons),
    )


_MOST_BYTES: Final = 1 << 32
"""Limit of a file's size in memory; the sweeps of ten minutes need a third of it."""


def read_arrays(path: Path, head: str) -> tuple[Any, dict[str, Any]]:
    """Read a file of ``write_arrays``: the JSON in the array ``head``, and the other arrays.

    Raises:
        InputError: The file cannot be read, is none of these, or is larger than 4 GiB in memory.
    """
    try:
        arrays = plain_files.read_arrays(path, _MOST_BYTES)
        return plain_files.load_json(str(arrays.pop(head))), arrays
    except (OSError, ValueError, KeyError) as error:
        raise InputError("file", str(path), f"a file of an earlier run ({error})") from error


def write_arrays(path: Path, arrays: Mapping[str, Any], *, compressed: bool = True) -> None:
    """Write several arrays to a numpy file, completely or not at all; OSError if it cannot be written."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with whole_file(path) as new:
        (np.savez_compressed if compressed else np.savez)(new, **arrays)
