"""Calls in processes: results, progress, errors, and processes that crash, hang, are killed or lose their server."""

import json
import multiprocessing.forkserver
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from concurrent.futures import CancelledError, Future
from concurrent.futures.process import BrokenProcessPool
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

import pebble
import pytest

from siren_ros.base.processes.process_pool import CrashError, ProcessPool, side_by_side
from siren_ros.errors import EpisodeError, InputError, SirenError
from siren_ros.simulation.scenario.templates import load_template

DOUBLES = """
import json, sys
from siren_ros.base.processes.process_pool import ProcessPool, simulated_time
def double(number):
    reach = simulated_time()
    reach(float(number)), reach(number + 0.75), reach(number + 1.0)  # told in steps of at least half a second
    return 2 * number
def refuse(number):
    raise ValueError(f"{number} is refused")
reports = []
with ProcessPool(int(sys.argv[1]), reports.append) as pool:
    doubles = pool.map(double, [(number,) for number in range(1, 6)])
print(json.dumps(doubles), json.dumps(reports), sep=chr(10))
try:
    with ProcessPool(int(sys.argv[1]), reports.append) as pool:
        pool.map(refuse, [(7,)])
except ValueError as error:
    print(json.dumps(str(error)))
"""
SLEEPERS = """
import os, sys, time
from siren_ros.base.processes.process_pool import ProcessPool
def sleep():
    os.write(1, f"{os.getpid()}\\n".encode())  # at once, also where Python writes unbuffered
    time.sleep(60.0)
if __name__ == "__main__":
    with ProcessPool(2, fresh="fresh" in sys.argv) as pool:
        pool.map(sleep, [(), ()])
"""


@pytest.mark.parametrize("processes", [1, 2])
def test_results_progress_and_errors_come_back(processes: int) -> None:
    done = subprocess.run(
        [sys.executable, "-c", DOUBLES, str(processes)], capture_output=True, text=True, check=True, timeout=60
    )
    results, reports, error = map(json.loads, done.stdout.splitlines())
    assert results == [2, 4, 6, 8, 10]
    assert sorted(reports) == [0.75] * 5 + [1.0, 2.0, 3.0, 4.0, 5.0]
    assert error == "7 is refused"


@pytest.mark.parametrize(
    ("words", "number"),
    [([], signal.SIGKILL), (["fresh"], signal.SIGKILL), (["fresh"], signal.SIGTERM), ([], signal.SIGINT)],
)
def test_processes_end_with_a_program_that_is_ended(tmp_path: Path, words: list[str], number: int) -> None:
    program_file = tmp_path / "sleepers.py"  # the fork server's processes load the program's file
    program_file.write_text(SLEEPERS)
    command = [sys.executable, str(program_file), *words]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as program:
        assert program.stdout is not None
        sleeping = [int(program.stdout.readline()) for _ in range(2)]
        program.send_signal(number)
        program.wait()
    deadline_s = time.monotonic() + 30.0
    while any(map(runs, sleeping)) and time.monotonic() < deadline_s:
        time.sleep(0.05)
    assert not any(map(runs, sleeping))


WAITS_FOR_SERVER = """
from siren_ros.base.processes.process_pool import ProcessPool
if __name__ == "__main__":
    try:
        with ProcessPool(1, fresh=True, preload="slow"):
            pass
    except KeyboardInterrupt:
        print("interrupted")
"""
SLOW = """
import os, signal, time
from siren_ros.base.processes.interrupts import signal_at_end_of_parent
signal_at_end_of_parent(signal.SIGTERM)
os.write(1, f"{os.getpid()}\\n".encode())
time.sleep(60.0)
"""


def test_ctrl_c_while_the_server_loads_its_modules_is_for_the_program_alone(tmp_path: Path) -> None:
    """A terminal sends it to both. The server would print a traceback, or go on alone."""
    (tmp_path / "slow.py").write_text(SLOW)
    program_file = tmp_path / "waits.py"
    program_file.write_text(WAITS_FOR_SERVER)
    with subprocess.Popen(
        [sys.executable, str(program_file)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        cwd=tmp_path,  # the server finds its modules there
    ) as program:
        assert program.stdout is not None
        server = int(program.stdout.readline())
        os.killpg(program.pid, signal.SIGINT)
        printed, said = program.communicate()  # ends when the server, which has the same pipes, is gone
    assert (program.returncode, printed, said) == (0, "interrupted\n", "")
    assert not runs(server)


def runs(pid: int) -> bool:
    with suppress(OSError):
        os.kill(pid, 0)
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] != "Z"  # ended, but not yet awaited
    return False


@pytest.fixture
def pool() -> Iterator[ProcessPool]:
    """One fresh process for each call."""
    with ProcessPool(1, fresh=True) as running:
        yield running


def test_every_call_has_a_process_of_its_own_and_errors_of_the_project_stay_what_they_are(pool: ProcessPool) -> None:
    assert len({pool.call(os.getpid), pool.call(os.getpid), os.getpid()}) == 3
    with pytest.raises(InputError, match="'S9'") as refused:
        pool.call(load_template, "S9")
    assert refused.value.exit_code == 2


LATER = "import os, signal, time; time.sleep(0.3); "
"""Waits until pebble has read which call the process has begun; it does not know the reason of an earlier end."""


@pytest.mark.parametrize(
    ("function", "argument", "reason"),
    [
        (json.loads, "{", r"^JSONDecodeError: .* \(decoder.py:\d+\)$"),
        (exec, LATER + "os._exit(7)", "^its process ended with exit code 7$"),
        (exec, LATER + "signal.raise_signal(signal.SIGSEGV)", "^its process was killed by SIGSEGV$"),
        (exec, LATER + "signal.raise_signal(signal.SIGTERM)", "^its process was ended by SIGTERM$"),
    ],
)
def test_an_end_without_an_answer_says_its_reason(pool, function, argument, reason) -> None:
    with pytest.raises(CrashError, match=reason):
        pool.call(function, argument)


def test_a_process_that_dies_among_many_is_named_too() -> None:
    with ProcessPool(2) as pool, pytest.raises(CrashError, match="killed by SIGKILL, as where memory runs out"):
        pool.map(exec, [(LATER + "signal.raise_signal(signal.SIGKILL)",)])


def broken(*reasons: str) -> Future[Any]:
    """What pebble answers to a call when all its processes are gone."""
    answer: Future[Any] = Future()
    answer.set_exception(BrokenProcessPool(*reasons))
    return answer


def workers() -> list[int]:
    return [child.pid or 0 for child in multiprocessing.active_children()]


def test_a_hanging_process_is_killed(pool: ProcessPool) -> None:
    (hanging,) = workers()
    with pytest.raises(CrashError, match=r"^its process gave no answer for 0.5 s$"):
        pool.call(time.sleep, 600.0, timeout_s=0.5)
    assert not runs(hanging)


def test_a_pool_that_cannot_start_its_threads_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(_thread: object) -> None:
        raise RuntimeError("can't start new thread")

    monkeypatch.setattr(threading.Thread, "start", refuse)
    with pytest.raises(CrashError, match=r"cannot be started \(can't start new thread"), ProcessPool(2):
        pass
    assert not workers()


def test_all_who_wait_for_a_process_go_on_when_the_pool_is_stopped(pool: ProcessPool) -> None:
    (sleeping,), stopped = workers(), []

    def wait() -> None:
        try:
            pool.call(time.sleep, 600.0)
        except CancelledError as error:
            stopped.append(error)

    waiting = [threading.Thread(target=wait, daemon=True) for _ in range(3)]
    for thread in waiting:
        thread.start()
    time.sleep(0.3)
    pool.stop()
    for thread in waiting:
        thread.join(30.0)
    assert len(stopped) == 3
    assert not runs(sleeping)
    with pytest.raises(CancelledError):
        pool.call(os.getpid)


STAYS_IN_A_FOLDER = """
import tempfile, time
with tempfile.TemporaryDirectory(dir={!r}):
    time.sleep(600.0)
"""


def test_the_temporary_folders_of_processes_that_are_ended_are_removed(pool: ProcessPool, tmp_path: Path) -> None:
    def stop() -> None:
        while not list(tmp_path.glob("*")):  # until the time limit of the test
            time.sleep(0.05)
        pool.stop()

    stopping = threading.Thread(target=stop)
    stopping.start()
    with pytest.raises(CancelledError):
        pool.call(exec, STAYS_IN_A_FOLDER.format(str(tmp_path)))
    stopping.join()
    assert not list(tmp_path.iterdir())


def test_a_pool_that_breaks_while_it_is_stopped_counts_as_stopped(pool, monkeypatch):
    def stopped(*_: Any, **__: Any) -> Future[Any]:
        pool.stop()
        return broken()

    for reasons, said in (((), "server of new processes is gone"), (("All workers expired",), "as it began a call$")):
        with monkeypatch.context() as patched:
            patched.setattr(pebble.ProcessPool, "schedule", lambda *_, why=reasons, **__: broken(*why))
            with pytest.raises(CrashError, match=said):
                pool.call(os.getpid)
    monkeypatch.setattr(pebble.ProcessPool, "schedule", stopped)
    with pytest.raises(CancelledError) as cancelled:
        pool.call(os.getpid)
    assert isinstance(cancelled.value.__cause__, BrokenProcessPool)


def test_a_killed_fork_server_is_named_and_the_next_call_has_another(pool: ProcessPool) -> None:
    (orphan,) = workers()
    with pytest.raises(CrashError, match=r"^the server of its process was killed$"):
        pool.call(exec, "import os, time; os.kill(os.getppid(), 9); time.sleep(600.0)")
    while runs(orphan):  # until the time limit of the test
        time.sleep(0.05)
    assert pool.call_with_retries(1, os.getpid) != os.getpid()


@pytest.mark.parametrize("starts_pool", [True, False])
def test_a_fork_server_that_is_killed_while_it_starts_a_process_costs_a_call_at_most(starts_pool, monkeypatch) -> None:
    connect = multiprocessing.forkserver.connect_to_new_process
    with ProcessPool(1, fresh=True) as before:
        server = before.call(os.getppid)

    def killing(fds: Any) -> Any:
        monkeypatch.undo()
        os.kill(server, signal.SIGSTOP)  # it takes the connection, and answers no more
        threading.Timer(0.1, os.kill, (server, signal.SIGKILL)).start()
        return connect(fds)

    if starts_pool:
        multiprocessing.forkserver.ensure_running()
        monkeypatch.setattr(multiprocessing.forkserver, "connect_to_new_process", killing)
    with ProcessPool(1, fresh=True) as pool:
        monkeypatch.setattr(multiprocessing.forkserver, "connect_to_new_process", connect if starts_pool else killing)
        reasons = []
        for _ in range(3):
            try:
                assert pool.call(os.getpid) != os.getpid()
            except CrashError as error:
                reasons.append(str(error))
    assert reasons in ([], ["the server of new processes is gone (EOFError)"])
    assert not runs(server)


def added(first: int, second: int) -> int:
    return first + second


@pytest.fixture
def answers(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """What calls answer, one after the other; without an answer they return what the function does."""
    given: list[Any] = []

    def call(_pool: ProcessPool, function: Any, *arguments: Any) -> Any:
        if not given:
            return function(*arguments)
        raise given.pop(0)

    monkeypatch.setattr(ProcessPool, "call", call)
    return given


@pytest.mark.parametrize("retries", [0, 2])
def test_an_answer_counts_after_as_many_deaths_as_may_be(answers: list[Any], retries: int) -> None:
    answers.extend([CrashError("killed")] * retries)
    assert ProcessPool(1, fresh=True).call_with_retries(retries, added, 3, 4) == 7
    assert not answers
    answers.extend(CrashError(f"signal {number}") for number in range(5))
    reasons = "; ".join(f"signal {number}" for number in range(retries + 1))
    with pytest.raises(CrashError, match=rf"added: {reasons}$"):
        ProcessPool(1, fresh=True).call_with_retries(retries, added, 3, 4)
    assert len(answers) == 4 - retries


@pytest.mark.parametrize("error", [InputError("map", "x", "no such map"), EpisodeError("no such map")])
def test_what_the_function_refuses_is_not_tried_again(answers: list[Any], error: SirenError) -> None:
    answers.extend([CrashError("killed"), error])
    with pytest.raises(type(error), match="no such map"):
        ProcessPool(1, fresh=True).call_with_retries(5, added, 3, 4)
    assert not answers


def test_results_have_the_names_of_their_tasks_and_two_workers_work_at_the_same_time() -> None:
    tasks = {f"{number} squared": partial(pow, number, 2) for number in range(7)}
    for workers in (1, 3):
        assert side_by_side(tasks, workers) == {f"{number} squared": number**2 for number in range(7)}
    meeting = threading.Barrier(2)
    arrivals = side_by_side({name: partial(meeting.wait, 30.0) for name in "ab"}, 2)
    assert sorted(arrivals.values()) == [0, 1]


def test_the_first_error_is_raised_and_nothing_new_begins() -> None:
    begun = []

    def task(number: int) -> None:
        begun.append(number)
        if number == 1:
            raise EpisodeError("the second task")
        time.sleep(0.05)  # as work does, so that there is time to stop the others

    with pytest.raises(EpisodeError, match="the second task"):
        side_by_side({str(number): partial(task, number) for number in range(50)}, 1)
    assert begun[:2] == [0, 1]
    assert len(begun) < 50
