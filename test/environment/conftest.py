"""Checkouts, DDS domains and programs for the tests of the environment."""

import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from pathlib import Path

import pytest
from dds_domains import own_domain
from environment_support import TALKER, Checkout, ros_variables, running

from small_ros2.main import main


@pytest.fixture
def checkout(tmp_path: Path) -> Checkout:
    root = tmp_path / "check out"
    root.mkdir()
    return Checkout(root)


@pytest.fixture(scope="session")
def domain_id() -> str:
    """A DDS domain of this test process's own."""
    return str(own_domain())


@pytest.fixture
def start_ros2(domain_id: str) -> Iterator[Callable[..., "subprocess.Popen[str]"]]:
    """Starts the small ros2; what still runs at the end is killed."""
    started: list[subprocess.Popen[str]] = []

    def start(*arguments: str, variables: Mapping[str, str] | None = None) -> "subprocess.Popen[str]":
        process = subprocess.Popen(
            [sys.executable, "-m", "small_ros2", *arguments],
            env={**os.environ, **ros_variables(domain_id), **(variables or {})},
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )
        started.append(process)
        return process

    yield start
    for process in started:
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)  # and what it has started
        process.communicate()


@pytest.fixture
def ros2(
    domain_id: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> Callable[..., "subprocess.CompletedProcess[str]"]:
    """Runs the small ros2 to its end in this process, where it starts no other one."""

    def run(*arguments: str, variables: Mapping[str, str] | None = None) -> "subprocess.CompletedProcess[str]":
        for name, value in {**ros_variables(domain_id), "ROS_LOG_DIR": str(tmp_path), **(variables or {})}.items():
            monkeypatch.setenv(name, value)
        try:
            code: int | str | None = main(arguments)
        except SystemExit as ended:
            code = ended.code
        return subprocess.CompletedProcess(arguments, int(code or 0), *capsys.readouterr())

    return run


@pytest.fixture
def refused(ros2: Callable[..., "subprocess.CompletedProcess[str]"]) -> Callable[..., None]:
    """Runs a call that ends with an exit code and one line."""

    def run(words: list[str], exit_code: int, named: str, variables: Mapping[str, str] | None = None) -> None:
        result = ros2(*words, variables=variables)
        assert (result.returncode, result.stdout, result.stderr.count("\n")) == (exit_code, "", 1)
        assert named in result.stderr

    return run


@pytest.fixture(scope="session")
def talker(domain_id: str) -> Iterator[None]:
    """A node in a process of its own that publishes on three topics."""
    pytest.importorskip("rclpy", reason="needs ROS")
    with running(TALKER, domain_id):
        yield
