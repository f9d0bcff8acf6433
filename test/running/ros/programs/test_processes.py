"""Signals end a program in order or by force; a participant's process does not outlive the program that started it."""

import io
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest
from program_output import next_line

from siren_ros.running.ros.programs import processes
from siren_ros.running.ros.programs.processes import (
    AGAIN_S,
    FIRST_S,
    Awaited,
    Parent,
    Waiting,
    begin_silence,
    keep_silence,
)

PROGRAM = """
import sys, time
from siren_ros.running.ros.programs import processes
processes.SAME_S = float(sys.argv[1])
asked = processes.Interrupt("program")
print("ready", flush=True)
while not asked:
    time.sleep(0.01)
print("asked", flush=True)
sys.stdin.readline()
print(asked.signal_name, flush=True)
"""


@contextmanager
def started(word: object, program: str = PROGRAM) -> "Iterator[subprocess.Popen[str]]":
    """The program, ready for signals; it is gone afterwards."""
    process = subprocess.Popen(
        [sys.executable, "-c", program, str(word)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        assert next_line(process.stdout) == "ready\n"
        yield process
    finally:
        process.kill()
        process.communicate()


@pytest.mark.timeout(60)
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_signals_close_to_the_first_belong_to_it(number: signal.Signals) -> None:
    with started(60.0) as process:
        process.send_signal(number)
        assert next_line(process.stdout) == "asked\n"  # of signals that come at once, Python takes the lowest first
        process.send_signal(signal.SIGINT)
        process.send_signal(signal.SIGTERM)
        out, err = process.communicate("\n", timeout=30)
    assert (out, err, process.returncode) == (f"{number.name}\n", "", 0)


def test_a_later_signal_ends_the_program_with_one_line() -> None:
    with started(0.0) as process:
        process.send_signal(signal.SIGINT)
        assert next_line(process.stdout) == "asked\n"
        process.send_signal(signal.SIGINT)
        _, err = process.communicate(timeout=30)
    assert err == "program: ended at once by a second signal; `siren recover` completes a bag\n"
    assert process.returncode == -signal.SIGINT


def test_a_hangup_is_ignored_where_it_was() -> None:
    ignoring = f"import signal\nsignal.signal(signal.SIGHUP, signal.SIG_IGN)\n{PROGRAM}"
    with started(60.0, ignoring) as process:
        process.send_signal(signal.SIGHUP)
        time.sleep(0.05)
        process.send_signal(signal.SIGTERM)
        assert next_line(process.stdout) == "asked\n"
        assert process.communicate("\n", timeout=30)[0] == "SIGTERM\n"


PREPARING = """
import sys, time
from siren_ros.running.ros.programs.processes import Interrupt, PreparationInterruptedError
asked = Interrupt("program")
if sys.argv[1] == "before":
    print("ready", flush=True)
    while not asked:
        time.sleep(0.01)
try:
    with asked.ending_at_once():
        print("ready", flush=True)
        while True:
            time.sleep(0.01)
except PreparationInterruptedError as error:
    sys.exit(str(error))
"""


@pytest.mark.timeout(60)
@pytest.mark.parametrize("when", ["before", "within"])
def test_what_is_prepared_ends_at_the_first_signal(when: str) -> None:
    with started(when, PREPARING) as process:
        process.send_signal(signal.SIGTERM)
        _, err = process.communicate(timeout=50)
    assert (err, process.returncode) == ("stopped by SIGTERM\n", 1)


def test_after_the_preparation_a_signal_is_only_remembered() -> None:
    preparation = "with asked.ending_at_once():\n    pass\n"
    with started(60.0, PROGRAM.replace('print("ready"', preparation + 'print("ready"')) as process:
        process.send_signal(signal.SIGTERM)
        out, _ = process.communicate("\n", timeout=50)
    assert (out, process.returncode) == ("asked\nSIGTERM\n", 0)


LOOK_S = 0.25


def lines_of(awaited: list[Awaited]) -> dict[float, str]:
    """The lines with their times, of what is waited for at each look."""
    silence, lines = begin_silence(awaited[0], 0.0), {}
    for look, now in enumerate(awaited):
        silence, line = keep_silence(silence, now, look * LOOK_S)
        if line:
            lines[look * LOOK_S] = line
    return lines


def looks(seconds: float, awaited: Awaited) -> list[Awaited]:
    return [awaited] * round(seconds / LOOK_S)


def test_a_long_wait_is_told_at_growing_intervals() -> None:
    lines = lines_of(looks(60.0, Awaited("the AV")))
    assert list(lines) == [FIRST_S, FIRST_S + AGAIN_S, FIRST_S + 3 * AGAIN_S, FIRST_S + 7 * AGAIN_S]
    assert lines[FIRST_S] == "waiting for the AV (3 s so far)"
    assert lines[FIRST_S + 3 * AGAIN_S] == "waiting for the AV (18 s so far)"


def test_something_else_is_told_sooner_but_not_in_a_row() -> None:
    lines = lines_of([*looks(20.0, Awaited("maps")), *looks(1.0, Awaited("cars")), *looks(40.0, Awaited("the AV"))])
    assert list(lines) == [3.0, 8.0, 18.0, 23.0, 28.0, 38.0, 58.0]
    assert lines[18.0] == "waiting for maps (18 s so far)"
    assert lines[23.0] == "waiting for the AV (2 s so far)"


def test_who_goes_on_is_silent() -> None:
    steps = [
        awaited for step in range(50) for awaited in looks(FIRST_S - LOOK_S, Awaited(f"a to finish step {step}", step))
    ]
    assert lines_of(steps) == {}
    assert lines_of(looks(60.0, Awaited(""))) == {}
    lines = lines_of([*steps, *looks(FIRST_S + LOOK_S, Awaited("b to finish step 50", 50, "it compiles"))])
    assert list(lines.values()) == ["waiting for b to finish step 50 (3 s so far; it compiles)"]


def test_the_thread_asks_and_says(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(processes, "LOOK_S", 0.001)
    monkeypatch.setattr(processes, "FIRST_S", 0.0)
    monkeypatch.setattr(processes, "AGAIN_S", 0.0)
    said, stream = threading.Event(), io.StringIO()
    with Waiting("cosim", "libraries", stream) as thread:
        thread.expect("the AV")
        printed = thread.say

        def say(line: str) -> None:
            printed(line)
            said.set()

        thread.say = say
        assert said.wait(30.0)
    assert stream.getvalue().splitlines()[-1].startswith("cosim: waiting for the AV")


PARENT = """
import os, subprocess, sys
child = subprocess.Popen([sys.executable, "-c", sys.argv[1], str(os.getpid())])
print(child.pid, flush=True)
input()
"""
STOPPED = """
import os, signal, sys, time
from siren_ros.running.ros.programs.processes import Parent
parent = Parent(int(sys.argv[1]))
print("ready", flush=True)
os.kill(os.getpid(), signal.SIGSTOP)
while not parent.is_gone:
    time.sleep(0.01)
"""
HANGING = """
import sys, time
from siren_ros.running.ros.programs import processes
processes.CLOSE_S = 0.2
processes.Parent(int(sys.argv[1]))
print("ready", flush=True)
time.sleep(1000)
"""


def state_of(process_id: int) -> str:
    """``R``, ``S``, ``T`` for stopped, ``Z``; empty: gone."""
    with suppress(OSError):
        return Path(f"/proc/{process_id}/stat").read_text(encoding="utf-8").rpartition(")")[2].split()[0]
    return ""


def wait_for(process_id: int, states: tuple[str, ...]) -> None:
    deadline_s = time.monotonic() + 30.0
    while state_of(process_id) not in states:
        assert time.monotonic() < deadline_s, f"still {state_of(process_id)}"
        time.sleep(0.02)


@contextmanager
def family(child: str) -> Iterator[tuple["subprocess.Popen[str]", int]]:
    """A program, and the process id of the child that it has started."""
    with subprocess.Popen(
        [sys.executable, "-c", PARENT, child], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as parent:
        assert parent.stdout is not None
        said = sorted(parent.stdout.readline().strip() for _ in range(2))
        number = int(said[0])
        assert said[1] == "ready"
        try:
            yield parent, number
        finally:
            parent.kill()
            with suppress(OSError):
                os.kill(number, 9)


pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="the signal at a parent's death is Linux's")


@pytest.mark.parametrize("child", [STOPPED, HANGING], ids=["stopped", "hanging"])
def test_it_ends_when_its_parent_is_killed(child: str) -> None:
    with family(child) as (parent, number):
        wait_for(number, ("T",) if child == STOPPED else ("S",))
        parent.kill()
        parent.wait()
        wait_for(number, ("", "Z"))


@pytest.mark.parametrize("parent", [0, os.getppid()], ids=["none that matters", "one that lives"])
def test_a_parent_that_lives_is_not_gone(parent: int) -> None:
    assert not Parent(parent).is_gone
