"""Programs that run beside each other in one DDS domain: episodes, listeners, controllers."""

import hashlib
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import pytest
from dds_domains import own_domain
from preloaded_programs import PreloadedProgram
from program_output import own_lines
from repository import REPOSITORY

EXAMPLES = REPOSITORY / "examples"
SMALL_SUITE = """
lidars:
  lidar: {mount: {x_m: 0.0, y_m: 0.0, z_m: 1.93}, channels: 8, points_per_second: 40000, rate_hz: 20}
"""


IN_ORDER = {0, -signal.SIGALRM}
"""How a node's program ends that has done its work; the latter where DDS needs more than its three seconds to end."""
_END_S = 5.0
"""Time that a program has to end before it is killed."""


@dataclass(frozen=True)
class Run:
    code: int
    out: str
    err: str

    @property
    def error_lines(self) -> list[str]:
        """Standard error without the progress, and without what a slow machine waits for."""
        return without_waiting([line for line in self.err.splitlines() if line and "steps," not in line])


class Domain:
    """Where programs hear each other; no other test's programs are there."""

    def __init__(self, programs: "type[subprocess.Popen[Any]]" = PreloadedProgram) -> None:
        """``programs`` starts them: ``subprocess.Popen`` as users do."""
        self._programs = programs

    @cached_property
    def number(self) -> int:
        return own_domain()

    @property
    def environment(self) -> dict[str, str]:
        profile = str(REPOSITORY / "params" / "fastdds_localhost.xml")
        return {
            "FASTRTPS_DEFAULT_PROFILES_FILE": profile,
            **os.environ,
            "ROS_DOMAIN_ID": str(self.number),
            "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        }

    def start(self, *arguments: str, cwd: Path | None = None) -> "subprocess.Popen[str]":
        """A Python program with pipes for its output."""
        return self._programs(
            [sys.executable, *arguments],
            env=self.environment,
            cwd=cwd,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )

    @contextmanager
    def running(self, *arguments: str, cwd: Path | None = None) -> Iterator["subprocess.Popen[str]"]:
        """A program that is gone afterwards, however the test ends.

        It is asked to end first: who is killed may have held a lock of the shared memory of DDS, and the domain's next
        programs do not find each other.
        """
        process = self.start(*arguments, cwd=cwd)
        try:
            yield process
        finally:
            if process.poll() is None:
                process.send_signal(signal.SIGCONT)
                process.terminate()
                with suppress(subprocess.TimeoutExpired):
                    process.communicate(timeout=_END_S)
                process.kill()
            process.communicate()

    @contextmanager
    def episode(self, *parameters: str, cwd: Path | None = None) -> Iterator["subprocess.Popen[str]"]:
        """An episode under way."""
        with self.running(*cosim(parameters), cwd=cwd) as process:
            yield process

    def run(self, *parameters: str, cwd: Path | None = None) -> Run:
        """An episode from its start to its end."""
        with self.episode(*parameters, cwd=cwd) as process:
            return finish(process, timeout_s=300.0)


def without_waiting(lines: Sequence[str]) -> list[str]:
    """Lines of standard error but for those that say what an episode waits for, which depend on the machine."""
    return [line for line in lines if not line.startswith("cosim: waiting for ")]


def cosim(parameters: Sequence[str]) -> list[str]:
    flags = [part for parameter in parameters for part in ("-p", parameter)]
    return ["-m", "siren_nodes.cosim", "--ros-args", *flags]


def finish(process: "subprocess.Popen[str]", timeout_s: float = 120.0) -> Run:
    out, err = process.communicate(timeout=timeout_s)
    return Run(process.returncode, own_lines(out), err)


def tell(process: "subprocess.Popen[str]") -> None:
    """Give a program that reads a line from its standard input that line."""
    assert process.stdin is not None
    process.stdin.write("\n")
    process.stdin.flush()


def wait_until(
    condition: Callable[[], bool], process: "subprocess.Popen[str] | subprocess.Popen[bytes]", timeout_s: float = 150.0
) -> None:
    """Poll until something holds of a running program; if it never does, say what the program printed.

    An episode gives up by itself after 120 s and names the node that was not ready, so it gets longer than that.
    """
    deadline_s = time.monotonic() + timeout_s
    while not condition():
        if process.poll() is None and time.monotonic() < deadline_s:
            time.sleep(0.02)
        elif not condition():
            process.send_signal(signal.SIGINT)
            out, err = process.communicate(timeout=60.0)
            pytest.fail(f"it never happened; the program ended with {process.returncode}\n{out!s}\n{err!s}")


def recording(folder: Path, size: int = 0) -> Callable[[], bool]:
    """Whether a bag below a folder has grown beyond a size."""
    return lambda: any(file.stat().st_size > size for file in folder.rglob("*.mcap"))


def digest(folder: Path) -> dict[str, str]:
    """Hash of every file below a folder."""
    return {
        str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }
