"""Workers of a study: whoever makes episodes and gives back their rows, in any order."""

import os
import signal
from collections.abc import Generator, Iterable
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from contextlib import suppress
from itertools import islice
from threading import Lock
from typing import Protocol

from siren_ros.errors import SirenError
from siren_ros.studies.episode_row import EpisodeRow
from siren_ros.studies.episode_worker import WorkerOptions, make_episode
from siren_ros.studies.matrix import PlannedEpisode
from siren_ros.studies.study_folder import StudyFolder


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
