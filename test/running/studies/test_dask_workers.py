"""Two Dask workers on this machine; one of them is killed while it works."""

import os
import signal
from collections.abc import Iterator
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest
from recorded_episode import quick_template

from siren_ros.cli.main import main
from siren_ros.errors import InputError
from siren_ros.running.studies.episode_row import EpisodeRow, Status
from siren_ros.running.studies.matrix import Study, plan_study
from siren_ros.running.studies.run_study import (
    DaskWorkers,
    StudyObserver,
    WorkerOptions,
    connected,
    make_on_worker,
    run_study,
)
from siren_ros.running.studies.study_folder import LocalFolder, read_table

pytestmark = [
    pytest.mark.filterwarnings("ignore"),
    pytest.mark.skipif(find_spec("distributed") is None, reason="needs the extra cluster: ./env --with cluster"),
]
STUDY = Study((quick_template("S2"), quick_template("S5")), ("L0", "own"), duration_s=0.5)
"""Four episodes: as the first is there, one is under way at each of two workers."""


@pytest.fixture(scope="module")
def cluster() -> Iterator[Any]:
    import dask
    import distributed

    with (
        dask.config.set({"distributed.worker.daemon": False}),
        distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as running,
    ):
        yield running


def client_of(cluster: Any) -> Any:
    import distributed

    return distributed.Client(cluster, set_as_default=False)


class KillOne(StudyObserver):
    """Kills the worker that works as the first row arrives."""

    def __init__(self, client: Any, study: Path) -> None:
        self._client = client
        self._study = study
        self.killed = ""

    def make(self, row: EpisodeRow) -> None:  # noqa: ARG002 - the interface
        if self.killed:
            return
        working = {address: tasks for address, tasks in self._client.processing().items() if tasks}
        self.killed = next(iter(working))
        process_id = self._client.run(os.getpid, workers=[self.killed])[self.killed]
        os.kill(process_id, signal.SIGKILL)


def test_a_worker_that_is_killed_costs_a_retry_and_nothing_else(cluster: Any, tmp_path: Path) -> None:
    with client_of(cluster) as client:
        kill = KillOne(client, tmp_path)
        result = run_study(STUDY, LocalFolder(tmp_path), DaskWorkers(client), observer=kill)
    assert kill.killed
    assert [row.status for row in result.rows] == [Status.COMPLETE] * 4
    retried = [row for row in result.rows if row.attempts > 1]
    assert len(retried) <= 1, "the killed worker made one episode at a time"
    for row in retried:
        assert row.retry_reasons == (f"worker {kill.killed} was lost",)
    assert len(read_table(LocalFolder(tmp_path))) == 4


def test_the_command_uses_a_running_scheduler(cluster: Any, tmp_path: Path) -> None:
    words = ["generate", "--templates", STUDY.templates[0], "--duration-s", "0.5", "--out", str(tmp_path)]
    assert main([*words, "--scheduler", cluster.scheduler_address]) == 0
    (row,) = read_table(LocalFolder(tmp_path))
    assert row.status is Status.COMPLETE


def test_a_scheduler_that_does_not_answer_is_refused() -> None:
    with pytest.raises(InputError, match="scheduler"):
        connected("carrier-pigeon://home")


@pytest.mark.parametrize(
    ("note", "reasons"),
    [
        (b'{"run": "now", "workers": ["tcp://gone"]}', ("worker tcp://gone was lost",)),
        (b"[" * 200_000, ()),
    ],
    ids=["lost", "damaged"],
)
def test_a_worker_that_is_lost_is_noted_by_the_next_one(
    cluster: Any, tmp_path: Path, note: bytes, reasons: tuple[str, ...]
) -> None:
    episode = plan_study(replace(STUDY, templates=STUDY.templates[:1], levels=("own",)))[0]
    folder = LocalFolder(tmp_path)
    folder.write(f"begun/{episode.group}/{episode.name}.json", note)
    with client_of(cluster) as client:
        content = client.submit(make_on_worker, episode, folder, WorkerOptions(), "now", pure=False).result()
    row = EpisodeRow.from_json(content)
    assert (row.attempts, row.retry_reasons) == (1 + len(reasons), reasons)
