"""Studies of episodes of a second: made, resumed, verified, tried again, and with workers that die."""

import os
import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable, Generator, Iterable
from dataclasses import replace
from pathlib import Path
from threading import Lock
from typing import Any

import pytest
import yaml
from recorded_episode import quick_template
from synthetic_episode import NET_XML

from siren_ros.base.processes.process_pool import CrashError, ProcessPool
from siren_ros.data.recording.bag_reader import read_episode
from siren_ros.errors import EpisodeError, InputError, SirenError
from siren_ros.running.studies.episode_row import EpisodeRow, Status
from siren_ros.running.studies.matrix import PlannedEpisode, Seat, Study, plan_study
from siren_ros.running.studies.run_study import (
    LocalWorkers,
    StudyObserver,
    StudyResult,
    WorkerOptions,
    make_episode,
    run_study,
)
from siren_ros.running.studies.study_folder import MANIFEST, LocalFolder, StudyFolder, read_table
from siren_ros.running.studies.study_folder import STUDY as STUDY_FILE
from siren_ros.simulation.scenario.episode import EpisodeRequest

STUDY = Study((quick_template("S2"), quick_template("S5")), ("L0", "own"), duration_s=1.0)


class Made(StudyObserver):
    """Keeps the names of the episodes that are made."""

    def __init__(self) -> None:
        self.names: list[str] = []

    def make(self, row: EpisodeRow) -> None:
        self.names.append(row.episode)


@pytest.fixture(scope="module")
def first_run(tmp_path_factory: pytest.TempPathFactory) -> tuple[StudyResult, LocalFolder, Path]:
    root = tmp_path_factory.mktemp("study")
    folder = LocalFolder(root)
    return run_study(STUDY, folder, LocalWorkers(2)), folder, root


def test_a_study_has_a_bag_and_a_row_for_every_episode(first_run: tuple[StudyResult, LocalFolder, Path]) -> None:
    result, folder, root = first_run
    assert [row.status for row in result.rows] == [Status.COMPLETE] * 4
    assert read_table(folder) == tuple(sorted(result.rows, key=lambda row: row.episode))
    for row in result.rows:
        record = read_episode(root / row.bag)
        assert record.complete
        assert (record.description.template, record.description.level.name) == (Path(row.template).stem, row.level)
        assert record.outcome is not None
        assert record.outcome.predicate_holds == row.predicate_holds
        assert record.description.map_sha256 == row.map_sha256
        assert row.simulated_s == 1.0
        assert 0.0 < row.run_s < row.process_s
        assert row.attempts == 1
    assert not list(root.glob(".work/*")), "nothing is left of the attempts"


def test_a_study_is_resumed_by_the_hashes_of_its_bags(first_run: tuple[StudyResult, LocalFolder, Path]) -> None:
    before, folder, root = first_run
    damaged, forgotten = root / before.rows[1].bag, before.rows[2]
    (file,) = damaged.glob("*.mcap")
    content = file.read_bytes()
    file.write_bytes(content[:-1] + bytes([content[-1] ^ 1]))
    (root / forgotten.bag / "metadata.yaml").unlink()
    made = Made()
    again = run_study(STUDY, folder, LocalWorkers(2), observer=made)
    assert sorted(made.names) == sorted([before.rows[1].episode, forgotten.episode])
    assert again.kept == 2
    assert [row.mcap_sha256 for row in again.rows] == [row.mcap_sha256 for row in before.rows]
    assert file.read_bytes() == content, "an episode that is made again has the same bytes"


def test_a_study_without_its_table_keeps_all_but_a_damaged_row_and_what_killed_processes_left_goes(first_run) -> None:
    before, folder, root = first_run
    (root / MANIFEST).unlink()
    damaged = before.rows[0]
    (root / f"{damaged.path}.json").write_text('{"episode": ', encoding="utf-8")
    (root / ".work" / f"{2**22 + 1}-0123456789ab" / ".bag.partial").mkdir(parents=True)
    made = Made()
    again = run_study(STUDY, folder, LocalWorkers(2), observer=made)
    assert made.names == [damaged.episode]
    assert len(read_table(folder)) == len(before.rows)
    assert [row.mcap_sha256 for row in again.rows] == [row.mcap_sha256 for row in before.rows]
    assert not (root / ".work").exists()


def test_a_study_grows_and_keeps_what_it_had(first_run: tuple[StudyResult, LocalFolder, Path]) -> None:
    _, folder, _ = first_run
    made = Made()
    run_study(replace(STUDY, templates=STUDY.templates[:1], levels=("L1",)), folder, LocalWorkers(2), observer=made)
    assert made.names == ["S2_L1_seed0"]
    assert len(read_table(folder)) == 5


class Refusing(LocalWorkers):
    """Workers that make nothing; before that, another run makes another study in the same folder."""

    def __init__(self, meanwhile: Study | None = None, reason: str = "a test") -> None:
        super().__init__(1)
        self.meanwhile, self.reason = meanwhile, reason

    def rows(
        self, planned: Iterable[PlannedEpisode], folder: StudyFolder, options: WorkerOptions
    ) -> Generator[EpisodeRow, None, None]:
        if self.meanwhile is not None:
            run_study(self.meanwhile, folder, Refusing(), options)
        yield from (EpisodeRow.planned(episode, Status.REFUSED, self.reason) for episode in planned)


def test_runs_that_share_a_folder_keep_one_anothers_rows(tmp_path: Path) -> None:
    folder = LocalFolder(tmp_path)
    run_study(STUDY, folder, Refusing(meanwhile=replace(STUDY, seeds=(7,))))
    assert Counter(row.seed for row in read_table(folder)) == {0: 4, 7: 4}
    run_study(STUDY, folder, Refusing(meanwhile=STUDY, reason="later"))
    assert Counter((row.seed, row.reason) for row in read_table(folder)) == {(0, "later"): 4, (7, "a test"): 4}


def test_a_folder_with_other_episodes_of_these_names_is_refused(
    first_run: tuple[StudyResult, LocalFolder, Path],
) -> None:
    _, folder, _ = first_run
    asked = folder.read(STUDY_FILE)
    with pytest.raises(InputError, match="other inputs"):
        run_study(replace(STUDY, preset="realistic"), folder, LocalWorkers(1))
    assert folder.read(STUDY_FILE) == asked, "of the study that the folder holds"


def test_a_worker_that_is_killed_costs_one_retry_and_nothing_else(first_run, tmp_path, monkeypatch) -> None:
    killed, starts, lock = "S5_L1_seed0", Counter[str](), Lock()
    call = ProcessPool.call

    def killing(pool: ProcessPool, function: Any, request: Any, bag: Path, *others: Any, timeout_s: float) -> Any:
        """The first process of one episode kills itself."""
        with lock:
            starts[bag.name] += 1
        if bag.name == killed and starts[killed] == 1:
            return call(pool, signal.raise_signal, signal.SIGKILL)
        return call(pool, function, request, bag, *others, timeout_s=timeout_s)

    monkeypatch.setattr(ProcessPool, "call", killing)
    result = run_study(STUDY, LocalFolder(tmp_path), LocalWorkers(2))
    assert starts == {row.episode: 2 if row.episode == killed else 1 for row in result.rows}
    assert [row.status for row in result.rows] == [Status.COMPLETE] * 4
    (victim,) = (row for row in result.rows if row.episode == killed)
    assert victim.attempts == 2
    assert victim.retry_reasons == ("its process was killed by SIGKILL, as where memory runs out",)
    assert LocalFolder(tmp_path).row_of(victim.path) == victim, "a study that goes on reads it from there"
    assert {row.mcap_sha256 for row in result.rows} == {row.mcap_sha256 for row in first_run[0].rows}
    assert not list(tmp_path.glob(".work/*"))


def test_what_cannot_be_made_is_told_and_not_tried_again(tmp_path: Path) -> None:
    grid = tmp_path / "road.net.xml"
    grid.write_text(NET_XML, encoding="utf-8")
    study = replace(STUDY, templates=("S4",), levels=("own",), maps=(str(grid),))
    result = run_study(study, LocalFolder(tmp_path / "out"), LocalWorkers(1))
    (row,) = result.rows
    assert row.status is Status.REFUSED
    assert row.attempts == 1
    assert "map" in row.reason
    assert read_table(LocalFolder(tmp_path / "out"))[0].reason == row.reason


def test_an_episode_whose_process_never_answers_is_given_up(tmp_path: Path) -> None:
    study = replace(STUDY, templates=("S2",), levels=("own",), duration_s=3000.0)
    result = run_study(study, LocalFolder(tmp_path), LocalWorkers(1), WorkerOptions(retries=1, timeout_s=1.0))
    (row,) = result.rows
    assert row.status is Status.CRASHED
    assert row.attempts == 2
    assert row.retry_reasons == (row.reason,)


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


ANSWERED = yaml.safe_load("""
{reason: "", steps: 801, simulated_s: 40.05, predicate_holds: true, predicate: it passed, measures: "{}", bag_bytes: 7,
 mcap_sha256: m0, metadata_sha256: y0, map_sha256: n0, site: made, setup_s: 1.5, run_s: 2.5, cpu_s: 3.5}""")


@pytest.mark.parametrize("status", [Status.COMPLETE, Status.FAILED])
def test_a_row_has_what_the_attempt_answers_and_what_its_plan_says(tmp_path: Path, status: Status) -> None:
    planned, asked = replace(PLANNED, seat=Seat("idm")), []

    def call(_: Any, request: EpisodeRequest, bag: Path, seat: Seat, limit_s: float, *, timeout_s: float) -> Any:
        asked.append((request, bag.name, seat, limit_s, timeout_s))
        if len(asked) == 1:
            raise CrashError("signal 9")
        bag.mkdir()
        return {**ANSWERED, "status": status}

    folder = LocalFolder(tmp_path)
    row = make_episode(planned, folder, WorkerOptions(timeout_s=90.0), call, earlier=("gone",))
    assert asked == [(PLANNED.request, "S2_L2_seed3", Seat("idm"), 75.0, 90.0)] * 2
    complete = status is Status.COMPLETE
    known = {**ANSWERED, "status": status, "bag": "episodes/S2_L2/S2_L2_seed3" if complete else ""}
    tried = {"attempts": 3, "retry_reasons": ("gone", "signal 9")}
    measured = {name: getattr(row, name) for name in ("process_s", "begun_at", "worker")}
    assert row == EpisodeRow.planned(planned, **known, **tried, **measured)
    assert measured["process_s"] > 0.0
    assert measured["worker"].endswith(f":{os.getpid()}")
    assert measured["begun_at"].endswith("+00:00")
    assert folder.row_of(row.path) == row
    assert (tmp_path / row.path).is_dir() is complete


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


def test_a_server_that_gets_ready_ends_with_its_program_and_leaves_no_folder(tmp_path: Path) -> None:
    """It makes an episode for seconds, in which it does not look for its program."""
    load = f"{sys.executable} -c 'import siren_ros.running.studies.ready_worker; print(\"ready\")' & echo $!; wait"
    variables = {**os.environ, "TMPDIR": str(tmp_path)}
    with subprocess.Popen(["/bin/sh", "-c", load], env=variables, stdout=subprocess.PIPE, text=True) as program:
        assert program.stdout is not None
        server = int(program.stdout.readline())
        while not list(tmp_path.glob("tmp*/.bag.partial/*.mcap")):
            assert program.poll() is None
            time.sleep(0.01)
        program.send_signal(signal.SIGKILL)
        assert program.stdout.read() == "", "until the server, which has the same pipe, is gone"
    assert not Path(f"/proc/{server}/cmdline").exists() or not Path(f"/proc/{server}/cmdline").read_bytes()
    assert not list(tmp_path.iterdir())
