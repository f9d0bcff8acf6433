"""Workers of a study on this machine: attempts at episodes in separate processes, until one gives a result."""

import gc
import os
import socket
import time
from collections.abc import Callable, Generator, Iterable
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import closing
from dataclasses import asdict, dataclass, replace
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Any, Final, Protocol

import numpy as np

from siren_ros.base.numerics.units import STEP_S
from siren_ros.base.processes.process_pool import CrashError, ProcessPool, as_ready
from siren_ros.data.interfaces.messages import json_text
from siren_ros.errors import EXIT_BAD_INPUT, SirenError
from siren_ros.running.generation.episode_setup import present_versions, set_up_episode
from siren_ros.running.generation.recorded_episode import record_episode
from siren_ros.running.seat.drivers.drivers import driver_of
from siren_ros.running.seat.seated import answers_of
from siren_ros.running.studies.av_program import LIMIT_S, episode_with_program
from siren_ros.running.studies.episode_row import EpisodeRow, Status
from siren_ros.running.studies.matrix import PlannedEpisode, Seat
from siren_ros.running.studies.study_folder import StudyFolder, attempt_folder, hashes_of_bag
from siren_ros.simulation.scenario.episode import EpisodeEnd, EpisodeRequest

TIMEOUT_S: Final = 3600.0
PROGRAMS_END_S: Final = 15.0
"""Wall time before the limit at which an attempt's programs are ended and their files removed."""
RETRIES: Final = 2
_GARBAGE_AFTER: Final = 100_000
"""New objects between runs of Python's garbage collector: a step makes thousands of objects, but no cycles."""
Call = Callable[..., Any]
"""``ProcessPool.call`` or a replacement."""


@dataclass(frozen=True)
class WorkerOptions:
    """Limits for making an episode."""

    retries: int = RETRIES
    """Number of further attempts after a process died or hung."""
    timeout_s: float = TIMEOUT_S
    """Wall time after which an attempt is killed."""


class Workers(Protocol):
    """Makes episodes in parallel."""

    def rows(
        self, planned: Iterable[PlannedEpisode], folder: StudyFolder, options: WorkerOptions
    ) -> Generator[EpisodeRow, None, None]:
        """Make the episodes and yield each row when it is known. Closing the iterator ends running work."""


class LocalWorkers:
    """Uses this machine's processors. A thread waits for each process; threads do not compute."""

    def __init__(self, count: int) -> None:
        self._count = count

    def rows(
        self, planned: Iterable[PlannedEpisode], folder: StudyFolder, options: WorkerOptions
    ) -> Generator[EpisodeRow, None, None]:
        """Implements ``Workers.rows``."""
        # The processes end before the threads that wait for them, so that no episode has to be finished.
        with ThreadPoolExecutor(self._count, "episode") as threads, attempt_processes(self._count) as pool:

            def begin(episode: PlannedEpisode) -> Future[EpisodeRow]:
                return threads.submit(make_episode, episode, folder, options, pool.call)

            with closing(as_ready(begin, planned, self._count)) as finished:
                for _, future in finished:
                    yield future.result()


def attempt_processes(count: int) -> ProcessPool:
    """Processes for attempts at episodes; each starts with everything loaded."""
    return ProcessPool(count, fresh=True, preload="siren_ros.running.studies.ready_worker")


def make_episode(
    planned: PlannedEpisode, folder: StudyFolder, options: WorkerOptions, call: Call, earlier: tuple[str, ...] = ()
) -> EpisodeRow:
    """Make an episode, move its bag to its place in the study's folder, and write its row.

    ``call`` calls a function in another process. ``earlier`` has the reasons of attempts of workers that are gone.
    """
    reasons = list(earlier)
    while True:
        row, crashed = _attempt(planned, folder, options, call, tuple(reasons))
        if not crashed or len(reasons) >= options.retries:
            break
        reasons.append(row.reason)
    if row.status is not Status.COMPLETE:
        folder.note(row)
    return row


def _attempt(
    planned: PlannedEpisode, folder: StudyFolder, options: WorkerOptions, call: Call, before: tuple[str, ...]
) -> tuple[EpisodeRow, bool]:
    """Row of one attempt, and whether another attempt may help; ``before`` has the reasons of earlier failures."""
    began_s = time.monotonic()
    row_with = partial(
        EpisodeRow.planned,
        planned,
        begun_at=datetime.now(UTC).isoformat(timespec="seconds"),
        worker=f"{socket.gethostname()}:{os.getpid()}",
        attempts=len(before) + 1,
        retry_reasons=before,
    )
    process_s, failing = 0.0, "no scratch folder"
    try:
        with attempt_folder(folder) as scratch:
            bag, failing = scratch / planned.name, "its bag cannot be kept"
            try:
                programs_limit_s = min(max(options.timeout_s - PROGRAMS_END_S, 0.5 * options.timeout_s), LIMIT_S)
                asked = (planned.request, bag, planned.seat, programs_limit_s)
                known = call(attempt_episode, *asked, timeout_s=options.timeout_s)
            finally:
                process_s = time.monotonic() - began_s
            row = row_with(**known, process_s=process_s)
            if row.status is Status.COMPLETE:
                row = replace(row, bag=row.path)
                folder.take(bag, row)
            return row, False
    except CrashError as error:
        return row_with(Status.CRASHED, str(error), process_s=process_s), True
    except SirenError as error:
        status = Status.REFUSED if error.exit_code == EXIT_BAD_INPUT else Status.FAILED
        return row_with(status, str(error), process_s=process_s), False
    except OSError as error:
        return row_with(Status.CRASHED, f"{failing}: {error}", process_s=process_s), True


def attempt_episode(
    request: EpisodeRequest,
    bag: Path,
    seat: Seat = Seat(),  # noqa: B008 - frozen
    programs_limit_s: float = LIMIT_S,
) -> dict[str, Any]:
    """Make an episode and its bag in the process of an attempt.

    Args:
        request: The episode.
        bag: Folder of the bag to write.
        seat: What drives its AV.
        programs_limit_s: Wall time that the programs of the seat have.

    Returns:
        What the episode's row tells of it: plain values, for the way between processes.

    Raises:
        InputError: The episode cannot be made.
        EpisodeError: Its bag cannot be written, or the program that drives its AV fails.
    """
    gc.set_threshold(_GARBAGE_AFTER)
    began_s, cpu_s = time.perf_counter(), _processor_s()
    setup = None if seat.program else set_up_episode(request)  # the program's ``cosim`` sets it up itself
    ready_s = time.perf_counter()
    if setup is None:
        recorded = episode_with_program(request, bag, seat.program, real_time=seat.real_time, limit_s=programs_limit_s)
    else:
        recorded = record_episode(setup, bag, answers_of(setup, driver_of(seat.driver)) if seat.driver else None)
    run_s = time.perf_counter() - ready_s
    outcome = recorded.outcome
    complete = outcome.end is EpisodeEnd.COMPLETE and recorded.bag is not None
    mcap_sha256, metadata_sha256 = hashes_of_bag(bag) if complete else ("", "")
    plain = {name: value.item() if isinstance(value, np.generic) else value for name, value in outcome.measures.items()}
    if recorded.answers is not None:
        plain |= {f"answers.{name}": value for name, value in asdict(recorded.answers).items()}
    return {
        "status": Status.COMPLETE if complete else Status.FAILED,
        "reason": outcome.reason,
        "steps": outcome.steps,
        "simulated_s": outcome.steps * STEP_S,
        "predicate_holds": outcome.predicate_holds,
        "predicate": str(plain.get("predicate", "")),
        "measures": json_text(plain),
        "bag_bytes": recorded.bag.size_bytes if recorded.bag is not None else 0,
        "mcap_sha256": mcap_sha256,
        "metadata_sha256": metadata_sha256,
        "map_sha256": recorded.description.map_sha256,
        "site": str(recorded.description.site["name"]),
        "versions": dict(present_versions()),
        "setup_s": ready_s - began_s,
        "run_s": run_s,
        "cpu_s": _processor_s() - cpu_s,
    }


def _processor_s() -> float:
    """Processor time of this process and of its finished children."""
    return sum(os.times()[:4])
