"""`ros2 launch` of the small ros2: the project's launch file, arguments, nodes, signals, and what it does not know."""

import os
import signal
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest
from environment_support import REPOSITORY
from program_output import next_line

from small_ros2.errors import CommandError
from small_ros2.launch_files import read_launch_file

Run = Callable[..., "subprocess.CompletedProcess[str]"]
Start = Callable[..., "subprocess.Popen[str]"]

TELL = """#!/usr/bin/env python3
import pathlib, signal, sys, time
signal.signal(signal.SIGINT, lambda *_: sys.exit(int(sys.argv[1])))
stays, said = sys.argv[2] == "stay", pathlib.Path(__file__ + ".said")
sys.stdout.write(" ".join(sys.argv[1:]) + "\\n")
sys.stdout.flush()
if stays:
    said.touch()
while stays or not said.exists():
    time.sleep(0.01)
"""
FILE = """
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, EmitEvent, RegisterEventHandler
from launch.event_handlers import OnProcessExit
from launch.events import Shutdown
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

def generate_launch_description():
    count = ParameterValue(LaunchConfiguration("count"), value_type=int)
    first = Node(package="some_pkg", executable="tell", name="first", arguments=["3", LaunchConfiguration("how")],
                 parameters=[{"count": count, "text": "a b"}], remappings=[("a", "b")])
    second = Node(package="some_pkg", executable="tell", arguments=["0", "stay"])
    return LaunchDescription([
        DeclareLaunchArgument("count", description="how many"),
        DeclareLaunchArgument("how", default_value="go"),
        first, second,
        RegisterEventHandler(OnProcessExit(target_action=first, on_exit=[EmitEvent(event=Shutdown())])),
    ])
"""


@pytest.fixture
def index(tmp_path: Path) -> dict[str, str]:
    """A package with an executable and a launch file."""
    for name in ("share/ament_index/resource_index/packages", "lib/some_pkg", "share/some_pkg/launch"):
        (tmp_path / name).mkdir(parents=True)
    (tmp_path / "share/ament_index/resource_index/packages/some_pkg").touch()
    (tmp_path / "share/some_pkg/launch/two.launch.py").write_text(FILE)
    (tmp_path / "lib/some_pkg/tell").write_text(TELL)
    (tmp_path / "lib/some_pkg/tell").chmod(0o755)
    return {"AMENT_PREFIX_PATH": str(tmp_path)}


def test_nodes_get_arguments_and_a_nodes_end_ends_the_launch(ros2: Run, index: dict[str, str]) -> None:
    result = ros2("launch", "some_pkg", "two.launch.py", "count:=4", "how:=go", variables=index)
    assert sorted(result.stdout.splitlines()) == [
        "0 stay --ros-args",
        '3 go --ros-args -r __node:=first -r a:=b -p count:=4 -p text:="a b"',
    ]
    assert (result.returncode, result.stderr) == (0, "")


def test_ctrl_c_reaches_the_nodes_and_an_error_is_told(start_ros2: Start, index: dict[str, str]) -> None:
    process = start_ros2("launch", "some_pkg", "two.launch.py", "count:=4", "how:=stay", variables=index)
    assert {next_line(process.stdout).split()[1] for _ in range(2)} == {"stay"}
    os.killpg(process.pid, signal.SIGINT)
    _, errors = process.communicate(timeout=30)
    assert (process.returncode, errors) == (1, "")


def test_arguments_are_shown_and_demanded(ros2: Run, index: dict[str, str]) -> None:
    shown = ros2("launch", "some_pkg", "two.launch.py", "--show-args", variables=index).stdout
    assert "'count':\n        how many\n" in shown
    assert "'how':\n        no description given\n        (default: 'go')" in shown
    missing = ros2("launch", "some_pkg", "two.launch.py", variables=index)
    assert missing.returncode == 2
    assert "'count'" in missing.stderr
    wrong = ros2("launch", "some_pkg", "two.launch.py", "count:=many", variables=index)
    assert wrong.returncode == 2
    assert "'many'" in wrong.stderr


def test_the_projects_own_file_becomes_an_episode() -> None:
    declared, (cosim,) = read_launch_file(REPOSITORY / "launch" / "cosim.launch.py")
    values = {argument.name: str(argument.default) for argument in declared} | {"template": "S5"}
    words = cosim.ros_arguments(values)
    assert (cosim.package, cosim.executable, cosim.ends_launch) == ("siren_ros", "cosim", True)
    assert words[:5] == ["--ros-args", "-p", 'template:="S5"', "-p", 'level:=""']


def test_launch_files_are_found_in_the_environment(ros2: Run) -> None:
    assert "'template'" in ros2("launch", "siren_ros", "cosim.launch.py", "--show-args").stdout


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("from launch.actions import TimerAction", "launch.actions.TimerAction"),
        ("import launch_xml_no_such", "launch_xml_no_such"),
        ("def generate_launch_description(): raise SystemExit(3)", "SystemExit"),
    ],
)
def test_what_a_file_cannot_have_is_named(tmp_path: Path, text: str, named: str) -> None:
    file = tmp_path / "x.launch.py"
    file.write_text(text)
    with pytest.raises(CommandError, match=named):
        read_launch_file(file)
    with pytest.raises(CommandError, match="only Python"):
        read_launch_file(tmp_path / "x.launch.xml")
