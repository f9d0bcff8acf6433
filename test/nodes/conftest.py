"""Episodes run as a user runs them: the program cosim in a process of its own, with its own DDS domain."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import pytest

DOMAIN_ID = 60


@dataclass(frozen=True)
class Run:
    code: int
    out: str
    err: str

    @property
    def error_lines(self) -> list[str]:
        return [line for line in self.err.splitlines() if line and "steps," not in line]


def environment() -> dict[str, str]:
    return {**os.environ, "ROS_DOMAIN_ID": str(DOMAIN_ID), "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}


def command(parameters: Sequence[str]) -> list[str]:
    flags = [part for parameter in parameters for part in ("-p", parameter)]
    return [sys.executable, "-m", "siren_nodes.cosim", "--ros-args", *flags]


@pytest.fixture(scope="session")
def cosim() -> Callable[..., Run]:
    """Runs an episode to its end."""

    def run(*parameters: str, cwd: Path | None = None, timeout_s: float = 180.0) -> Run:
        done = subprocess.run(
            command(parameters),
            env=environment(),
            cwd=cwd,
            capture_output=True,
            text=True,
            timeout=timeout_s,
            check=False,
        )
        return Run(done.returncode, done.stdout, done.stderr)

    return run


@pytest.fixture(scope="session")
def stopped_cosim() -> Callable[..., Run]:
    """Runs an episode and sends it a signal when it has come far enough."""

    def run(*parameters: str, cwd: Path, number: signal.Signals, when: Callable[[], bool]) -> Run:
        process = subprocess.Popen(
            command(parameters), env=environment(), cwd=cwd, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        )
        deadline = time.monotonic() + 60.0
        while not when() and process.poll() is None and time.monotonic() < deadline:
            time.sleep(0.05)
        process.send_signal(number)
        out, err = process.communicate(timeout=60.0)
        return Run(process.returncode, out, err)

    return run
