"""`ros2 run` and `ros2 pkg`: the package index, exit codes, signals, and calls that cannot be understood."""

import os
import signal
import subprocess
from collections.abc import Callable, Mapping
from pathlib import Path

import pytest

Run = Callable[..., "subprocess.CompletedProcess[str]"]
Start = Callable[..., "subprocess.Popen[str]"]

WAITER = """#!/usr/bin/env python3
import signal, time
interrupts = []
signal.signal(signal.SIGINT, lambda *_: interrupts.append(1))
print("ready", flush=True)
while not interrupts:  # pause() would miss a signal that comes before it
    time.sleep(0.01)
time.sleep(0.1)  # a second one would come now
print(len(interrupts), flush=True)
raise SystemExit(7)
"""


def add_executable(prefix: Path, package: str, name: str, script: str) -> None:
    marker = prefix / "share/ament_index/resource_index/packages" / package
    marker.parent.mkdir(parents=True, exist_ok=True)
    marker.touch()
    path = prefix / "lib" / package / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(script)
    path.chmod(0o755)


@pytest.fixture
def index(tmp_path: Path) -> Mapping[str, str]:
    """Two prefixes; the first one hides the second one's package of the same name."""
    add_executable(tmp_path / "over", "some_pkg", "tell", '#!/bin/sh\necho over\nfor a in "$@"; do echo "<$a>"; done\n')
    add_executable(tmp_path / "under", "some_pkg", "tell", "#!/bin/sh\necho under\n")
    add_executable(tmp_path / "under", "other_pkg", "waiter", WAITER)
    (tmp_path / "under/lib/other_pkg/notes.txt").write_text("not executable")
    return {"AMENT_PREFIX_PATH": f"{tmp_path / 'over'}{os.pathsep}{tmp_path / 'under'}"}


def test_arguments_reach_the_executable_untouched(ros2: Run, index: Mapping[str, str]) -> None:
    words = ["--ros-args", "-p", "template:=S2", "--help", "-r", "a b"]
    result = ros2("run", "some_pkg", "tell", *words, variables=index)
    assert result.returncode == 0
    assert result.stdout.splitlines() == ["over", *(f"<{word}>" for word in words)]


def test_ctrl_c_reaches_the_executable_once_and_its_exit_code_comes_back(
    start_ros2: Start, index: Mapping[str, str]
) -> None:
    process = start_ros2("run", "other_pkg", "waiter", variables=index)
    assert process.stdout is not None
    assert process.stdout.readline() == "ready\n"
    os.killpg(process.pid, signal.SIGINT)  # what a terminal does
    assert process.communicate(timeout=10)[0] == "1\n"
    assert process.returncode == 7


def test_executables_are_listed(ros2: Run, index: Mapping[str, str]) -> None:
    everything = ros2("pkg", "executables", variables=index).stdout
    assert everything == "other_pkg waiter\nsome_pkg tell\ntf2_ros tf2_echo\ntf2_tools view_frames\n"
    assert ros2("pkg", "executables", "other_pkg", variables=index).stdout == "other_pkg waiter\n"


def test_the_prefix_of_a_package_is_printed(ros2: Run, index: Mapping[str, str], tmp_path: Path) -> None:
    assert ros2("pkg", "prefix", "some_pkg", variables=index).stdout == f"{tmp_path / 'over'}\n"


@pytest.mark.parametrize(
    ("words", "exit_code", "named"),
    [
        (["run", "no_pkg", "tell"], 1, "no_pkg"),
        (["run", "other_pkg", "nothing"], 1, "waiter"),
        (["pkg", "executables", "no_pkg"], 1, "no_pkg"),
        (["launch", "some_pkg"], 1, "some_pkg"),
        (["launch", "some_pkg", "no.launch.py"], 1, "no.launch.py"),
        (["launch", "some_pkg", "x.launch.py", "word"], 2, "word"),
        (["interface", "show", "String"], 1, "String"),
        (["interface", "show", "no_msgs/msg/String"], 1, "no_msgs/msg/String"),
        (["service", "list"], 2, "service"),
        (["topic", "pub"], 2, "pub"),
        (["run", "some_pkg"], 2, "executable"),
        ([], 2, "COMMAND"),
        (["bag", "info", "/no/such/bag"], 1, "/no/such/bag"),
        (["bag", "play", "x", "-r", "0"], 2, "--rate"),
        (["bag", "play", "x", "--start-offset", "nan"], 2, "--start-offset"),
    ],
)
def test_a_call_that_cannot_be_done_gets_one_line(
    ros2: Run, index: Mapping[str, str], words: list[str], exit_code: int, named: str
) -> None:
    result = ros2(*words, variables=index)
    assert result.returncode == exit_code
    assert result.stdout == ""
    assert result.stderr.count("\n") == 1
    assert named in result.stderr


@pytest.mark.parametrize("words", [["--help"], ["run", "--help"], ["topic", "echo", "--help"], ["bag", "play", "-h"]])
def test_help_is_everywhere(ros2: Run, words: list[str]) -> None:
    result = ros2(*words)
    assert result.returncode == 0
    assert result.stdout.startswith("usage: ros2")
