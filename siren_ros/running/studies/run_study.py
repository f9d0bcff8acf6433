"""Runs a study: verifies finished episodes, lets workers make the others, writes the table.

Workers make episodes in separate processes, and try again until an attempt gives a result. They are on this machine, or
on a cluster: there Dask schedules (it needs the extra ``cluster``), and moves the episodes of a worker that is lost to
another one.
"""

import gc
import json
import os
import socket
import time
from collections import Counter
from collections.abc import Callable, Generator, Iterable
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import closing, suppress
from dataclasses import asdict, dataclass, fields, replace
from datetime import UTC, datetime
from functools import partial
from importlib import import_module
from itertools import islice
from pathlib import Path
from typing import Any, Final, Protocol
from uuid import uuid4

import numpy as np
from tqdm import tqdm

from siren_ros.base.numerics.arrays import Brief, data_frame
from siren_ros.base.numerics.units import STEP_S
from siren_ros.base.params import plain_files
from siren_ros.base.processes.process_pool import CrashError, ProcessPool, as_ready
from siren_ros.data.interfaces.messages import json_text
from siren_ros.errors import EXIT_BAD_INPUT, InputError, SirenError
from siren_ros.running.generation.closed_loop import record_episode
from siren_ros.running.generation.episode_setup import present_versions, set_up_episode
from siren_ros.running.seat.drivers.drivers import driver_of
from siren_ros.running.seat.seated import answers_of
from siren_ros.running.studies.av_program import LIMIT_S, episode_with_program
from siren_ros.running.studies.episode_row import EpisodeRow, Status, path_of
from siren_ros.running.studies.matrix import PlannedEpisode, Seat, Study, plan_study
from siren_ros.running.studies.study_folder import (
    StudyFolder,
    attempt_folder,
    hashes_of_bag,
    is_finished,
    read_table,
    write_study,
    write_table,
)
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
        "site": str(recorded.description.site.get("name", "")),
        "versions": dict(present_versions()),
        "setup_s": ready_s - began_s,
        "run_s": run_s,
        "cpu_s": _processor_s() - cpu_s,
    }


def _processor_s() -> float:
    """Processor time of this process and of its finished children."""
    return sum(os.times()[:4])


PROLOGUE: Final = "export DASK_DISTRIBUTED__WORKER__DAEMON=False"
"""Shell line for a worker's environment, because workers start processes."""
_AHEAD: Final = 3
"""Number of episodes handed to the scheduler per worker thread; all at once would fill its memory."""


class DaskWorkers:
    """Workers on a Dask cluster."""

    def __init__(self, client: Any) -> None:
        """Take a ``distributed.Client``."""
        self._client = client

    def rows(
        self, planned: Iterable[PlannedEpisode], folder: StudyFolder, options: WorkerOptions
    ) -> Generator[EpisodeRow, None, None]:
        """Make the episodes, as ``Workers``."""
        run, waiting = uuid4().hex, iter(planned)
        episodes: dict[str, PlannedEpisode] = {}
        gathered = _distributed().as_completed(loop=self._client.loop)

        def hand_out() -> None:
            ahead = max(1, sum(self._client.nthreads().values())) * _AHEAD
            for episode in islice(waiting, max(0, ahead - len(episodes))):
                future = self._client.submit(make_on_worker, episode, folder, options, run, pure=False)
                episodes[future.key] = episode
                gathered.add(future)

        try:
            hand_out()
            for future in gathered:
                yield _row(future, episodes.pop(future.key), folder)
                hand_out()
        finally:
            with suppress(Exception):
                self._client.cancel(list(gathered.futures), force=True)


def _distributed() -> Any:
    """The package Dask, from the extra ``cluster``."""
    return import_module("distributed")


def make_on_worker(episode: PlannedEpisode, folder: StudyFolder, options: WorkerOptions, run: str) -> dict[str, Any]:
    """Make an episode on a worker of a cluster; returns its row as JSON types.

    A note in the study's folder says who began. Where an earlier worker of this run began and did not end, it was lost,
    and the row says so.
    """
    name = f"begun/{episode.group}/{episode.name}.json"
    before: dict[str, Any] = {}
    with suppress(ValueError, TypeError):  # a damaged note names no worker
        before = dict(plain_files.load_json(folder.read(name) or b"{}"))
    lost = list(before.get("workers", ())) if before.get("run") == run else []
    folder.write(name, json.dumps({"run": run, "workers": [*lost, _distributed().get_worker().address]}).encode())
    with attempt_processes(1) as pool:
        row = make_episode(episode, folder, options, pool.call, tuple(f"worker {worker} was lost" for worker in lost))
    folder.write(name, b"{}")
    return row.to_json()


def _row(future: Any, episode: PlannedEpisode, folder: StudyFolder) -> EpisodeRow:
    try:
        return EpisodeRow.from_json(future.result())
    except SirenError:
        raise
    except Exception as error:  # noqa: BLE001 - Dask's own errors, and whatever a worker raised
        row = EpisodeRow.planned(episode, Status.CRASHED, f"{type(error).__name__}: {error}")
        folder.note(row)
        return row


def connected(scheduler: str) -> Any:
    """Connect to a running scheduler; InputError if Dask is not installed or the scheduler does not answer."""
    try:
        return _distributed().Client(scheduler, timeout="20s", set_as_default=False)
    except ImportError as error:
        raise InputError("scheduler", scheduler, "an environment with Dask: ./env --with cluster siren …") from error
    except (OSError, ValueError) as error:
        raise InputError("scheduler", scheduler, f"the address of a Dask scheduler ({error})") from error


def on_slurm(jobs: int) -> Any:
    """Start a cluster of Slurm jobs by Dask's configuration (``jobqueue.slurm``), and connect to it.

    Each job is one worker or several, as configured.

    Raises:
        InputError: dask-jobqueue is not installed, or Slurm or its configuration is missing.
    """
    try:
        cluster = import_module("dask_jobqueue").SLURMCluster(job_script_prologue=[PROLOGUE])
        cluster.scale(jobs=jobs)
        return _distributed().Client(cluster, set_as_default=False)
    except ImportError as error:
        raise InputError("slurm", jobs, "an environment with dask-jobqueue: ./env --with cluster siren …") from error
    except (OSError, ValueError, RuntimeError) as error:
        raise InputError("slurm", jobs, f"a machine that submits Slurm jobs, configured for Dask ({error})") from error


TABLE_EVERY_S: Final = 60.0
"""Wall time between writes of the table; the row next to each bag is written at once."""


@dataclass(frozen=True)
class StudyResult(Brief):
    """Result of a study."""

    rows: tuple[EpisodeRow, ...]
    """Rows of this study's episodes, in their order."""
    kept: int
    """Number of episodes that were finished before."""

    def facts(self) -> dict[str, object]:
        """Number of episodes by their result."""
        ends = Counter(row.status.value for row in self.rows)
        return {"episodes": len(self.rows), "kept": self.kept, **ends}

    def to_pandas(self) -> Any:
        """A ``pandas.DataFrame`` with a row for each episode and the columns of ``manifest.parquet``.

        Raises:
            InputError: pandas is not installed.
        """
        names = [column.name for column in fields(EpisodeRow)]
        return data_frame({name: [getattr(row, name) for row in self.rows] for name in names})


class StudyObserver:
    """Observes the progress of a study; commands show it as a bar."""

    def plan(self, episodes: int) -> None:
        """Called first, with the number of episodes."""

    def keep(self, row: EpisodeRow) -> None:
        """Called for an episode that was finished before."""

    def make(self, row: EpisodeRow) -> None:
        """Called for an episode with a new result."""


class StudyBar(StudyObserver):
    """A progress bar with rate and remaining time."""

    def __init__(self, bar: "tqdm[Any]") -> None:
        self._bar = bar
        self._counts: Counter[str] = Counter()
        self._simulated_s = 0.0

    def plan(self, episodes: int) -> None:
        """Implements ``StudyObserver.plan``."""
        self._bar.reset(episodes)

    def keep(self, row: EpisodeRow) -> None:  # noqa: ARG002 - the interface
        """Implements ``StudyObserver.keep``."""
        if not self._bar.disable:
            self._bar.initial += 1  # it took no time, so it must not count for the rate
            self._bar.update(1)

    def make(self, row: EpisodeRow) -> None:
        """Implements ``StudyObserver.make``."""
        if self._bar.disable:
            return
        self._counts["retried"] += row.attempts - 1
        self._counts[row.status.value] += 1
        self._simulated_s += row.simulated_s
        counts = {name: count for name, count in self._counts.items() if count and name != Status.COMPLETE.value}
        factor = self._simulated_s / max(self._bar.format_dict["elapsed"], 1e-3)
        self._bar.set_postfix({"simulated": f"{factor:.1f}x", **counts}, refresh=False)
        self._bar.update(1)


def run_study(
    study: Study,
    folder: StudyFolder,
    workers: Workers,
    options: WorkerOptions | None = None,
    observer: StudyObserver | None = None,
) -> StudyResult:
    """Make all unfinished episodes of a study. Episodes of earlier studies in the folder stay.

    Raises:
        InputError: The study cannot be used, the folder cannot be written, or it holds an episode of the same name
            that was made from something else.
    """
    observer = observer or StudyObserver()
    planned = plan_study(study)
    observer.plan(len(planned))
    known = {row.episode: row for row in read_table(folder)}
    rows: dict[str, EpisodeRow] = {}
    for episode in planned:
        row = finished_row(episode, folder, known.get(episode.name))
        if row is not None:
            rows[episode.name] = row
            observer.keep(row)
    write_study(folder, study.to_json())  # only now, because a study that is refused must not be stored
    folder.clear_scratch()
    kept, next_table_s = len(rows), time.monotonic() + TABLE_EVERY_S
    todo = [episode for episode in planned if episode.name not in rows]
    try:
        with closing(workers.rows(todo, folder, options or WorkerOptions())) as new_rows:
            for row in new_rows:
                rows[row.episode] = row
                observer.make(row)
                if (began_s := time.monotonic()) >= next_table_s:
                    _write_rows(folder, rows)
                    # Writing a table of a million rows takes seconds; the interval keeps it a small part of the time.
                    next_table_s = time.monotonic() + max(TABLE_EVERY_S, 20.0 * (time.monotonic() - began_s))
    finally:
        _write_rows(folder, rows)
        folder.clear_scratch()
    return StudyResult(tuple(rows[episode.name] for episode in planned), kept)


def _write_rows(folder: StudyFolder, rows: dict[str, EpisodeRow]) -> None:
    """Write the table with these rows; rows that another run has written meanwhile stay."""
    write_table(folder, ({row.episode: row for row in read_table(folder)} | rows).values())


def finished_row(episode: PlannedEpisode, folder: StudyFolder, known: EpisodeRow | None) -> EpisodeRow | None:
    """Row of a finished episode; None if the episode must be made.

    The bag's bytes are hashed and compared with the row.

    Raises:
        InputError: The folder has an episode of this name that was made from something else.
    """
    row = known if known is not None and is_finished(folder, known) else None
    if row is None:  # a killed coordinator wrote no table, or an old one
        row = folder.row_of(path_of(episode.group, episode.name))
        if row is None or not is_finished(folder, row):
            return None
    if row.inputs_sha256 != episode.inputs_sha256:
        allowed = f"a new folder; this one has {row.episode} made from other inputs, files or versions"
        raise InputError("out", folder.place, allowed)
    return row
