"""`ros2 run`, `pkg` and `launch`: programs are found, started and ended."""

import os
import signal
import subprocess
from collections.abc import Callable, Mapping
from pathlib import Path

import pytest
from environment_support import REPOSITORY
from program_output import next_line

from small_ros2.errors import CommandError
from small_ros2.launch_files import read_launch_file

Run = Callable[..., "subprocess.CompletedProcess[str]"]
Start = Callable[..., "subprocess.Popen[str]"]

ENVIRONMENT = {"AMENT_PREFIX_PATH": os.environ.get("AMENT_PREFIX_PATH", "")}
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


def test_arguments_reach_the_executable_untouched(start_ros2: Start, index: Mapping[str, str]) -> None:
    words = ["--ros-args", "-p", "template:=S2", "--help", "-r", "a b"]
    process = start_ros2("run", "some_pkg", "tell", *words, variables=index)
    assert process.communicate(timeout=10)[0].splitlines() == ["over", *(f"<{word}>" for word in words)]
    assert process.returncode == 0


def test_ctrl_c_reaches_the_executable_once_and_its_exit_code_comes_back(start_ros2, index) -> None:
    process = start_ros2("run", "other_pkg", "waiter", variables=index)
    assert process.stdout is not None
    assert process.stdout.readline() == "ready\n"
    os.killpg(process.pid, signal.SIGINT)  # what a terminal does
    assert process.communicate(timeout=10)[0] == "1\n"
    assert process.returncode == 7


def test_executables_are_listed(ros2: Run, index: Mapping[str, str], tmp_path: Path) -> None:
    everything = ros2("pkg", "executables", variables=index).stdout
    assert everything == "other_pkg waiter\nsome_pkg tell\ntf2_ros tf2_echo\ntf2_tools view_frames\n"
    assert ros2("pkg", "executables", "other_pkg", variables=index).stdout == "other_pkg waiter\n"
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
        (["topic", "pub"], 2, "pub"),
        (["run", "some_pkg"], 2, "executable"),
        ([], 2, "COMMAND"),
        (["bag", "info", "/no/such/bag"], 1, "/no/such/bag"),
        (["bag", "play", "x", "-r", "0"], 2, "--rate"),
        (["bag", "play", "x", "--start-offset", "nan"], 2, "--start-offset"),
    ],
)
def test_a_call_that_cannot_be_done_gets_one_line(refused, index, words, exit_code, named) -> None:
    refused(words, exit_code, named, index)


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
def launch_index(tmp_path: Path) -> dict[str, str]:
    """A package with an executable and a launch file."""
    add_executable(tmp_path, "some_pkg", "tell", TELL)
    (tmp_path / "share/some_pkg/launch").mkdir(parents=True)
    (tmp_path / "share/some_pkg/launch/two.launch.py").write_text(FILE)
    return {"AMENT_PREFIX_PATH": str(tmp_path)}


def test_nodes_get_arguments_and_a_nodes_end_ends_the_launch(start_ros2: Start, launch_index: dict[str, str]) -> None:
    process = start_ros2("launch", "some_pkg", "two.launch.py", "count:=4", "how:=go", variables=launch_index)
    printed, errors = process.communicate(timeout=30)
    assert sorted(printed.splitlines()) == [
        "0 stay --ros-args",
        '3 go --ros-args -r __node:=first -r a:=b -p count:=4 -p text:="a b"',
    ]
    assert (process.returncode, errors) == (0, "")


def test_ctrl_c_reaches_the_nodes_and_an_error_is_told(start_ros2: Start, launch_index: dict[str, str]) -> None:
    process = start_ros2("launch", "some_pkg", "two.launch.py", "count:=4", "how:=stay", variables=launch_index)
    assert {next_line(process.stdout).split()[1] for _ in range(2)} == {"stay"}
    os.killpg(process.pid, signal.SIGINT)
    _, errors = process.communicate(timeout=30)
    assert (process.returncode, errors) == (1, "")


def test_arguments_are_shown_and_demanded(ros2, refused, launch_index) -> None:
    shown = ros2("launch", "some_pkg", "two.launch.py", "--show-args", variables=launch_index).stdout
    assert "'count':\n        how many\n" in shown
    assert "'how':\n        no description given\n        (default: 'go')" in shown
    refused(["launch", "some_pkg", "two.launch.py"], 2, "'count'", launch_index)
    refused(["launch", "some_pkg", "two.launch.py", "count:=many"], 2, "'many'", launch_index)
    assert "'template'" in ros2("launch", "siren_ros", "cosim.launch.py", "--show-args", variables=ENVIRONMENT).stdout


def test_the_projects_own_file_becomes_an_episode() -> None:
    declared, (cosim,) = read_launch_file(REPOSITORY / "launch" / "cosim.launch.py")
    values = {argument.name: str(argument.default) for argument in declared} | {"template": "S5"}
    words = cosim.ros_arguments(values)
    assert (cosim.package, cosim.executable, cosim.ends_launch) == ("siren_ros", "cosim", True)
    assert words[:5] == ["--ros-args", "-p", 'template:="S5"', "-p", 'level:=""']


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
