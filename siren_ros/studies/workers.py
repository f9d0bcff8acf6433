"""Workers of a study on this machine: attempts at episodes in processes of their own, until one has an answer."""

import os
import signal
import socket
import time
from collections.abc import Callable, Generator, Iterable
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from contextlib import ExitStack, suppress
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from itertools import islice
from pathlib import Path
from threading import Lock
from typing import Any, Final, Protocol

from siren_ros.errors import EXIT_BAD_INPUT, SirenError
from siren_ros.processes.own_process import Died, Refused, Returned, call_in_own_process
from siren_ros.studies.episode_row import EpisodeRow, Status
from siren_ros.studies.matrix import PlannedEpisode
from siren_ros.studies.recorded_attempt import Attempt, attempt_episode, measures_text
from siren_ros.studies.study_folder import StudyFolder, attempt_folder

TIMEOUT_S: Final = 3600.0
RETRIES: Final = 2


@dataclass(frozen=True)
class WorkerOptions:
    """How hard an episode is tried."""

    retries: int = RETRIES
    """Further attempts after one whose process died or hung."""
    timeout_s: float = TIMEOUT_S
    """Wall time after which an attempt is killed."""


def make_episode(
    planned: PlannedEpisode,
    folder: StudyFolder,
    options: WorkerOptions | None = None,
    started: Callable[[int], None] = lambda _: None,
    earlier: tuple[str, ...] = (),
) -> EpisodeRow:
    """Makes an episode, moves its bag to its place in the study's folder, and writes its row.

    Args:
        planned: The episode.
        folder: The study's folder.
        options: How hard it is tried.
        started: Told the id of each attempt's process.
        earlier: Reasons of attempts that were made before, by workers that are gone.
    """
    wanted = options or WorkerOptions()
    reasons = list(earlier)
    while True:
        row, died = _attempt(planned, folder, wanted, started, tuple(reasons))
        if not died or len(reasons) >= wanted.retries:
            break
        reasons.append(row.reason)
    if row.status is not Status.COMPLETE:
        folder.note(row)
    return row


def _attempt(
    planned: PlannedEpisode,
    folder: StudyFolder,
    wanted: WorkerOptions,
    started: Callable[[int], None],
    before: tuple[str, ...],
) -> tuple[EpisodeRow, bool]:
    """The row of one attempt, and whether its process died; ``before`` says why the earlier ones were in vain."""
    with ExitStack() as opened:
        began_s = time.monotonic()
        timing: dict[str, Any] = {
            "begun_at": datetime.now(UTC).isoformat(timespec="seconds"),
            "worker": f"{socket.gethostname()}:{os.getpid()}",
            "attempts": len(before) + 1,
            "retry_reasons": before,
        }
        try:
            bag = opened.enter_context(attempt_folder(folder)) / planned.name
        except OSError as error:
            return EpisodeRow.planned(planned, Status.CRASHED, f"no scratch folder: {error}", **timing), True
        answer = call_in_own_process(attempt_episode, planned.request, bag, timeout_s=wanted.timeout_s, started=started)
        timing["process_s"] = time.monotonic() - began_s
        if isinstance(answer, Died):
            return EpisodeRow.planned(planned, Status.CRASHED, answer.reason, **timing), True
        if isinstance(answer, Refused):
            status = Status.REFUSED if answer.exit_code == EXIT_BAD_INPUT else Status.FAILED
            return EpisodeRow.planned(planned, status, answer.reason, **timing), False
        try:
            return _taken(planned, folder, bag, answer, timing), False
        except OSError as error:
            return EpisodeRow.planned(planned, Status.CRASHED, f"its bag cannot be kept: {error}", **timing), True


def _taken(
    planned: PlannedEpisode, folder: StudyFolder, bag: Path, answer: Returned[Attempt], timing: dict[str, Any]
) -> EpisodeRow:
    made = answer.value
    row = EpisodeRow.planned(
        planned,
        Status.COMPLETE if made.complete else Status.FAILED,
        made.reason,
        steps=made.steps,
        simulated_s=made.simulated_s,
        predicate_holds=made.predicate_holds,
        predicate=str(made.measures.get("predicate", "")),
        measures=measures_text(made),
        bag_bytes=made.bag_bytes,
        mcap_sha256=made.mcap_sha256,
        metadata_sha256=made.metadata_sha256,
        map_sha256=made.map_sha256,
        setup_s=made.setup_s,
        run_s=made.run_s,
        cpu_s=made.cpu_s,
        versions=made.versions,
        **timing,
    )
    if not made.complete:
        return row
    row = replace(row, bag=row.path)
    folder.take(bag, row)
    return row


class StoppedError(SirenError):
    """The study was stopped while an episode was under way."""


class Workers(Protocol):
    """Makes episodes side by side."""

    def rows(
        self, planned: Iterable[PlannedEpisode], folder: StudyFolder, options: WorkerOptions
    ) -> Generator[EpisodeRow, None, None]:
        """Makes the episodes; gives each row when it is known. Closing the iterator ends what is under way."""


class LocalWorkers:
    """This machine's processors. A thread waits for each process; none of them computes."""

    def __init__(self, count: int) -> None:
        self._count = count
        self._lock = Lock()
        self._running: set[int] = set()
        self._stopped = False

    def rows(
        self, planned: Iterable[PlannedEpisode], folder: StudyFolder, options: WorkerOptions
    ) -> Generator[EpisodeRow, None, None]:
        """As ``Workers``."""
        waiting = iter(planned)
        self._stopped = False
        pool = ThreadPoolExecutor(self._count, "episode")

        def submitted(count: int) -> set[Future[EpisodeRow]]:
            return {pool.submit(self._make, episode, folder, options) for episode in islice(waiting, count)}

        try:
            under_way = submitted(self._count)
            while under_way:
                done, under_way = wait(under_way, return_when=FIRST_COMPLETED)
                under_way |= submitted(len(done))
                for future in done:
                    yield future.result()
        finally:
            self._end_all()
            pool.shutdown(cancel_futures=True)

    def _make(self, episode: PlannedEpisode, folder: StudyFolder, options: WorkerOptions) -> EpisodeRow:
        mine: list[int] = []

        def started(process_id: int) -> None:
            with self._lock:
                self._running.difference_update(mine)
                mine[:] = [process_id]
                self._running.add(process_id)
                if self._stopped:  # no further attempt, and no row of an episode that nobody let end
                    raise StoppedError("the study was stopped")

        try:
            return make_episode(episode, folder, options, started)
        finally:
            with self._lock:
                self._running.difference_update(mine)

    def _end_all(self) -> None:
        with self._lock:
            self._stopped = True
            for process_id in self._running:
                _kill(process_id)


def _kill(process_id: int) -> None:
    with suppress(ProcessLookupError):
        os.kill(process_id, signal.SIGKILL)
