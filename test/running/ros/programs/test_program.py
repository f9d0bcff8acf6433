"""A node's program starts without a home, and ends, also where DDS does not let go of it."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from live_episodes import Domain, finish

from siren_ros.errors import InputError
from siren_ros.running.ros.programs.program import choose_log_folder

pytest.importorskip("rclpy", reason="needs ROS")

# Sleeps in C without giving up the interpreter's lock, as a destructor may.
STUCK = """
import ctypes
from rclpy.node import Node
from siren_ros.running.ros.programs import program

class Stuck(Node):
    finished = True
    def flush(self, timeout_s): pass
    def close_early(self, reason): pass
    def destroy_node(self):
        print("destroying", flush=True)
        ctypes.PyDLL(None).sleep(1000)

program.SHUTDOWN_S = 1
program.run_program(Stuck, "stuck")
"""


def test_a_node_that_cannot_be_destroyed_does_not_stay() -> None:
    with Domain().running("-c", STUCK) as process:
        run = finish(process, timeout_s=60.0)
    assert "destroying" in run.out
    assert run.code == -signal.SIGALRM


PROGRAM = """
import sys
from siren_nodes.cosim import main
sys.exit(main())
"""
NAMES = ("ROS_LOG_DIR", "ROS_HOME")


@pytest.fixture(autouse=True)
def _no_choice(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in NAMES:
        monkeypatch.delenv(name, raising=False)


@pytest.mark.parametrize("name", NAMES)
def test_a_users_own_choice_stays_where_it_can_be_written(
    name: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv(name, str(tmp_path / "mine"))
    choose_log_folder()
    assert [os.environ.get(variable) for variable in NAMES] == [
        str(tmp_path / "mine") if variable == name else None for variable in NAMES
    ]
    (tmp_path / "file").touch()
    monkeypatch.setenv(name, str(tmp_path / "file"))
    with pytest.raises(InputError, match=rf"^{name}: '.*file' cannot be used; allowed: a folder that can be written"):
        choose_log_folder()


def test_otherwise_it_is_below_the_home(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("HOME", str(tmp_path))
    choose_log_folder()
    assert os.environ["ROS_LOG_DIR"] == str(tmp_path / ".ros/log")


def without_home(home: str | None) -> dict[str, str]:
    environment = {key: value for key, value in Domain().environment.items() if key not in {"HOME", *NAMES}}
    return environment | ({} if home is None else {"HOME": home})


WORDS = [sys.executable, "-c", PROGRAM, "--ros-args", "-p", "no_such:=1"]


def assert_refused_by_name(run: "subprocess.CompletedProcess[str]") -> None:
    """One line beside those that say what a slow machine waits for."""
    lines = [line for line in run.stderr.splitlines() if not line.startswith("cosim: waiting for ")]
    assert (run.returncode, len(lines)) == (2, 1), run.stderr
    assert "no_such" in lines[0]


@pytest.mark.timeout(120)
def test_a_program_starts_without_a_home() -> None:
    """It comes as far as the user's mistake."""
    run = subprocess.run(WORDS, env=without_home(None), capture_output=True, text=True, check=False)
    assert_refused_by_name(run)
