"""How often an episode is tried, and what its row tells of it; its processes are stood in for."""

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from siren_ros.base.processes.process_pool import CrashError
from siren_ros.errors import EpisodeError, InputError, SirenError
from siren_ros.running.studies.episode_row import Status
from siren_ros.running.studies.matrix import PlannedEpisode, Study, plan_study
from siren_ros.running.studies.study_folder import LocalFolder
from siren_ros.running.studies.workers import LocalWorkers, WorkerOptions, make_episode
from siren_ros.simulation.scenario.episode import EpisodeRequest

PLANNED = PlannedEpisode("S2_L2_seed3", "S2_L2", EpisodeRequest("S2", "L2", 3), -1, "ab" * 32)


def answering(errors: list[SirenError]) -> Callable[..., Any]:
    """Stands in for the calls of processes: each raises the next of the errors."""

    def call(*_: Any, **__: Any) -> Any:
        raise errors.pop(0)

    return call


@pytest.mark.parametrize(("retries", "deaths", "attempts"), [(0, 3, 1), (1, 3, 2), (2, 3, 3), (2, 1, 2), (2, 0, 1)])
def test_an_attempt_that_died_is_made_again_as_often_as_may_be(tmp_path, retries, deaths, attempts) -> None:
    reasons = [f"signal {number}" for number in range(deaths)]
    call = answering([*map(CrashError, reasons), EpisodeError("SUMO failed")])
    row = make_episode(PLANNED, LocalFolder(tmp_path), WorkerOptions(retries=retries), call)
    assert row.attempts == attempts
    assert list(row.retry_reasons) == reasons[: attempts - 1]
    assert (row.status, row.reason) == (
        (Status.FAILED, "SUMO failed") if attempts > deaths else (Status.CRASHED, f"signal {attempts - 1}")
    )
    assert LocalFolder(tmp_path).row_of(row.path) == row


def test_attempts_of_workers_that_are_gone_count(tmp_path: Path) -> None:
    call = answering([CrashError("signal 9"), CrashError("signal 11")])
    row = make_episode(PLANNED, LocalFolder(tmp_path), WorkerOptions(retries=2), call, earlier=("gone",))
    assert (row.attempts, list(row.retry_reasons), row.reason) == (3, ["gone", "signal 9"], "signal 11")


class OtherError(SirenError):
    exit_code = 3


@pytest.mark.parametrize(
    ("error", "status"),
    [
        (InputError("map", "x", "a site"), Status.REFUSED),
        (EpisodeError("no such map"), Status.FAILED),
        (OtherError("no such map"), Status.FAILED),
    ],
)
def test_what_is_refused_is_not_tried_again(tmp_path: Path, error: SirenError, status: Status) -> None:
    errors = [error, CrashError("not asked for")]
    row = make_episode(PLANNED, LocalFolder(tmp_path), WorkerOptions(), answering(errors))
    assert (row.status, row.reason, row.attempts) == (status, str(error), 1)
    assert len(errors) == 1


def test_a_study_that_is_stopped_leaves_no_row_of_what_was_under_way(tmp_path: Path) -> None:
    planned = plan_study(Study(("S2",), seeds=(0, 1, 2), duration_s=0.5))
    endless = plan_study(Study(("S5",), seeds=(0,), duration_s=3000.0))
    rows = LocalWorkers(2).rows([*endless, *planned], LocalFolder(tmp_path), WorkerOptions())
    assert next(rows).episode == planned[0].name
    rows.close()
    assert not (tmp_path / "episodes" / endless[0].group).exists()
    assert not list(tmp_path.glob(".work/*"))


PROGRAM = """
from siren_ros.running.studies.workers import attempt_processes
loops = (
    "sum(bool(getattr(one, 'signatures', 0)) for one in "
    "vars(__import__('sys').modules['siren_ros.simulation.dynamics.fleet']).values())"
)
with attempt_processes(1) as pool:
    print(pool.call(eval, loops))
"""


def test_processes_of_attempts_begin_with_their_loops_at_hand() -> None:
    """In a program of its own: a process has one server for all of its pools, with what the first of them asked for."""
    done = subprocess.run([sys.executable, "-c", PROGRAM], capture_output=True, text=True, check=True)
    assert int(done.stdout) > 0
