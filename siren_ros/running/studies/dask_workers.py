"""Workers of a study on a cluster: Dask schedules, and each worker makes its episodes in separate processes.

Needs the extra ``cluster``. Dask moves the episodes of a worker that is lost to another one.
"""

import json
from collections.abc import Generator, Iterable
from contextlib import suppress
from importlib import import_module
from itertools import islice
from typing import Any, Final
from uuid import uuid4

from siren_ros.base.params import plain_json
from siren_ros.errors import InputError, SirenError
from siren_ros.running.studies.episode_row import EpisodeRow, Status
from siren_ros.running.studies.matrix import PlannedEpisode
from siren_ros.running.studies.study_folder import StudyFolder
from siren_ros.running.studies.workers import WorkerOptions, attempt_processes, make_episode

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
        before = dict(plain_json.load(folder.read(name) or b"{}"))
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
