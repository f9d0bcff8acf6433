"""A participant's process does not outlive the program that started it, whatever state it is in."""

import os
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest

from siren_ros.running.ros.programs.processes import Parent

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


def test_without_a_parent_that_matters_nothing_is_gone() -> None:
    assert not Parent(0).is_gone


def test_a_parent_that_lives_is_not_gone() -> None:
    assert not Parent(os.getppid()).is_gone
