"""How often an episode is tried, and what its row tells of it; its processes are stood in for."""

from pathlib import Path
from typing import Any

import pytest

from siren_ros.processes.own_process import Died, Refused
from siren_ros.scenario.episode import EpisodeRequest
from siren_ros.studies import workers as episode_worker
from siren_ros.studies.episode_row import Status
from siren_ros.studies.matrix import PlannedEpisode, Study, plan_study
from siren_ros.studies.study_folder import LocalFolder
from siren_ros.studies.workers import LocalWorkers, WorkerOptions, make_episode

PLANNED = PlannedEpisode("S2_L2_seed3", "S2_L2", EpisodeRequest("S2", "L2", 3), -1, "ab" * 32)


@pytest.fixture
def answers(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """What the processes answer, one after the other."""
    given: list[Any] = []
    monkeypatch.setattr(episode_worker, "call_in_own_process", lambda *_, **__: given.pop(0))
    return given


@pytest.mark.parametrize(("retries", "deaths", "attempts"), [(0, 3, 1), (1, 3, 2), (2, 3, 3), (2, 1, 2), (2, 0, 1)])
def test_an_attempt_that_died_is_made_again_as_often_as_may_be(
    answers: list[Any], tmp_path: Path, retries: int, deaths: int, attempts: int
) -> None:
    died = [Died(f"signal {number}") for number in range(deaths)]
    answers.extend([*died, Refused("SUMO failed", 1)])
    row = make_episode(PLANNED, LocalFolder(tmp_path), WorkerOptions(retries=retries))
    assert row.attempts == attempts
    assert list(row.retry_reasons) == [one.reason for one in died[: attempts - 1]]
    assert (row.status, row.reason) == (
        (Status.FAILED, "SUMO failed") if attempts > deaths else (Status.CRASHED, f"signal {attempts - 1}")
    )
    assert LocalFolder(tmp_path).row_of(row.path) == row


def test_attempts_of_workers_that_are_gone_count(answers: list[Any], tmp_path: Path) -> None:
    answers.extend([Died("signal 9"), Died("signal 11")])
    row = make_episode(PLANNED, LocalFolder(tmp_path), WorkerOptions(retries=2), earlier=("gone",))
    assert (row.attempts, list(row.retry_reasons), row.reason) == (3, ["gone", "signal 9"], "signal 11")


@pytest.mark.parametrize(("exit_code", "status"), [(2, Status.REFUSED), (1, Status.FAILED), (3, Status.FAILED)])
def test_what_is_refused_is_not_tried_again(answers: list[Any], tmp_path: Path, exit_code: int, status: Status) -> None:
    answers.extend([Refused("no such map", exit_code), Died("not asked for")])
    row = make_episode(PLANNED, LocalFolder(tmp_path))
    assert (row.status, row.reason, row.attempts) == (status, "no such map", 1)
    assert len(answers) == 1


def test_a_study_that_is_stopped_leaves_no_row_of_what_was_under_way(tmp_path: Path) -> None:
    planned = plan_study(Study(("S2",), seeds=(0, 1, 2), duration_s=0.5))
    endless = plan_study(Study(("S5",), seeds=(0,), duration_s=3000.0))
    rows = LocalWorkers(2).rows([*endless, *planned], LocalFolder(tmp_path), WorkerOptions())
    assert next(rows).episode == planned[0].name
    rows.close()
    assert not (tmp_path / "episodes" / endless[0].group).exists()
    assert not list(tmp_path.glob(".work/*"))
