"""Processes side by side: results, progress, errors, and no worker that outlives its program."""

import json
import os
import signal
import subprocess
import sys
import time
from contextlib import suppress

import pytest

DOUBLES = """
import json, sys
from siren_ros.processes.worker_pool import simulated_time, worker_pool
def double(number):
    simulated_time()(float(number))
    return 2 * number
def refuse(number):
    raise ValueError(f"{number} is refused")
told = []
with worker_pool(int(sys.argv[1]), told.append) as run:
    found = list(run(double, [(number,) for number in range(1, 6)]))
print(json.dumps(found), json.dumps(told), sep=chr(10))
try:
    with worker_pool(int(sys.argv[1]), told.append) as run:
        list(run(refuse, [(7,)]))
except ValueError as error:
    print(json.dumps(str(error)))
"""
SLEEPERS = """
import os, time
from siren_ros.processes.worker_pool import worker_pool
def sleep():
    os.write(1, f"{os.getpid()}\\n".encode())  # at once, also where Python writes unbuffered
    time.sleep(60.0)
with worker_pool(2, lambda _: None) as run:
    list(run(sleep, [(), ()]))
"""


@pytest.mark.parametrize("processes", [1, 2])
def test_results_progress_and_errors_come_back(processes: int) -> None:
    done = subprocess.run(
        [sys.executable, "-c", DOUBLES, str(processes)], capture_output=True, text=True, check=True, timeout=60
    )
    found, told, error = map(json.loads, done.stdout.splitlines())
    assert sorted(found) == [[number - 1, 2 * number] for number in range(1, 6)]
    assert sorted(told) == [1.0, 2.0, 3.0, 4.0, 5.0]
    assert error == "7 is refused"


def test_workers_end_with_a_program_that_is_killed() -> None:
    program = subprocess.Popen([sys.executable, "-c", SLEEPERS], stdout=subprocess.PIPE, text=True)
    assert program.stdout is not None
    workers = [int(program.stdout.readline().split()[0]) for _ in range(2)]
    program.send_signal(signal.SIGKILL)
    program.wait()
    program.stdout.close()
    deadline_s = time.monotonic() + 30.0
    while any(map(_runs, workers)) and time.monotonic() < deadline_s:
        time.sleep(0.05)
    assert not any(map(_runs, workers))


def _runs(pid: int) -> bool:
    with suppress(OSError):
        os.kill(pid, 0)
        with open(f"/proc/{pid}/stat") as file:  # noqa: PTH123 - a process that has ended and waits for its parent
            return file.read().rsplit(")", 1)[1].split()[0] != "Z"
    return False
