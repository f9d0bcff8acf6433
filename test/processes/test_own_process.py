import json
import multiprocessing.forkserver
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest

from siren_ros.errors import EpisodeError, InputError
from siren_ros.processes import own_process as retried
from siren_ros.processes.own_process import Died, Refused, Returned, call_in_own_process, in_own_process
from siren_ros.scenario.templates import load_template


def call(function: Any, *arguments: Any) -> object:
    return call_in_own_process(function, *arguments, timeout_s=60.0)


def test_every_call_has_a_process_of_its_own() -> None:
    first, second = call(os.getpid), call(os.getpid)
    assert isinstance(first, Returned)
    assert isinstance(second, Returned)
    assert len({first.value, second.value, os.getpid()}) == 3


def test_an_error_of_ours_is_told_with_its_exit_code() -> None:
    answer = call(load_template, "S9")
    assert isinstance(answer, Refused)
    assert "'S9'" in answer.reason
    assert answer.exit_code == 2


def test_an_end_without_an_answer_is_told() -> None:
    died = call(json.loads, "{")
    assert isinstance(died, Died)
    assert died.reason.startswith("JSONDecodeError: ")
    assert "decoder.py:" in died.reason
    assert call(os._exit, 7) == Died("its process ended with exit code 7")
    assert call(signal.raise_signal, signal.SIGSEGV) == Died("its process was killed by SIGSEGV")


def test_a_hanging_process_is_killed() -> None:
    seen: list[int] = []
    died = call_in_own_process(time.sleep, 600.0, timeout_s=0.5, started=seen.append)
    assert died == Died("its process gave no answer for 0.5 s")
    assert not Path(f"/proc/{seen[0]}").exists()


def kill_fork_server() -> int:
    server = multiprocessing.forkserver._forkserver._forkserver_pid  # type: ignore[attr-defined] # nobody else knows it
    os.kill(server, signal.SIGKILL)
    return int(server)


def test_a_killed_fork_server_is_told_and_the_next_call_has_another() -> None:
    assert isinstance(call(os.getpid), Returned)
    seen: list[int] = []

    def started(process_id: int) -> None:
        seen.append(process_id)
        kill_fork_server()

    died = call_in_own_process(time.sleep, 600.0, timeout_s=60.0, started=started)
    assert died == Died("the server of its process was killed")
    while Path(f"/proc/{seen[0]}/exe").exists():  # until the time limit of the test; a zombie has none
        time.sleep(0.05)
    assert isinstance(call(os.getpid), Returned)


def test_a_fork_server_that_is_killed_while_it_starts_a_process_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    assert isinstance(call(os.getpid), Returned)
    connect = multiprocessing.forkserver.connect_to_new_process

    def killing(fds: Any) -> Any:
        answer = connect(fds)
        os.kill(server, signal.SIGKILL)
        return answer

    server = multiprocessing.forkserver._forkserver._forkserver_pid  # type: ignore[attr-defined] # as above
    os.kill(server, signal.SIGSTOP)  # it takes the connection, and answers no more
    monkeypatch.setattr(multiprocessing.forkserver, "connect_to_new_process", killing)
    died = call(os.getpid)
    assert isinstance(died, Died)
    assert died.reason.startswith("the server of new processes is gone (")
    monkeypatch.undo()
    assert isinstance(call(os.getpid), Returned)


CALLER = """
import time
from siren_ros.processes.own_process import call_in_own_process
call_in_own_process(time.sleep, 600.0, timeout_s=600.0, started=lambda pid: print(pid, flush=True))
"""


def test_a_process_ends_when_the_one_that_called_is_killed() -> None:
    with subprocess.Popen([sys.executable, "-c", CALLER], stdout=subprocess.PIPE, text=True) as caller:
        assert caller.stdout is not None
        called = Path(f"/proc/{int(caller.stdout.readline())}")
        assert called.exists()
        caller.kill()
    while called.exists():  # until the time limit of the test
        time.sleep(0.05)


def added(first: int, second: int) -> int:
    return first + second


@pytest.fixture
def answers(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """What the processes answer, one after the other; without an answer they return what the function does."""
    given: list[Any] = []

    def call(function: Any, *arguments: Any, timeout_s: float) -> Any:
        assert timeout_s == pytest.approx(15.0 * 60.0)
        return given.pop(0) if given else Returned(function(*arguments))

    monkeypatch.setattr(retried, "call_in_own_process", call)
    return given


@pytest.mark.parametrize("deaths", [0, 1, 2])
def test_an_answer_counts_after_as_many_deaths_as_may_be(answers: list[Any], deaths: int) -> None:
    answers.extend([Died("killed")] * deaths)
    assert in_own_process(2, added, 3, 4) == 7
    assert not answers


@pytest.mark.parametrize("retries", [0, 2])
def test_one_death_more_is_an_error_that_tells_all_of_them(answers: list[Any], retries: int) -> None:
    answers.extend(Died(f"signal {number}") for number in range(5))
    told = "; ".join(f"signal {number}" for number in range(retries + 1))
    with pytest.raises(EpisodeError, match=rf"added: {told}$"):
        in_own_process(retries, added, 3, 4)
    assert len(answers) == 4 - retries


@pytest.mark.parametrize(("exit_code", "error"), [(2, InputError), (3, EpisodeError), (1, EpisodeError)])
def test_what_the_function_refuses_is_not_tried_again(
    answers: list[Any], exit_code: int, error: type[Exception]
) -> None:
    answers.extend([Died("killed"), Refused("no such map", exit_code)])
    with pytest.raises(error, match="no such map"):
        in_own_process(5, added, 3, 4)
    assert not answers
