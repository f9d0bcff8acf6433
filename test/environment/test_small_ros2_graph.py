"""`ros2 topic info`, `node`, `param` and `interface` next to real nodes in another process."""

import subprocess
from collections.abc import Callable

import pytest

rclpy = pytest.importorskip("rclpy", reason="needs ROS")

Run = Callable[..., "subprocess.CompletedProcess[str]"]
pytestmark = [pytest.mark.usefixtures("talker"), pytest.mark.timeout(120)]


def test_topic_info_counts_and_tells_quality_of_service(ros2: Run) -> None:
    result = ros2("topic", "info", "/test/latched")
    assert result.stdout.splitlines() == ["Type: std_msgs/msg/String", "Publisher count: 1", "Subscription count: 0"]
    assert "Durability: TRANSIENT_LOCAL" in ros2("topic", "info", "test/latched", "-v").stdout


def test_nodes_are_listed_and_described(ros2: Run) -> None:
    assert ros2("node", "list").stdout == "/talker\n"
    lines = ros2("node", "info", "talker").stdout.splitlines()
    assert lines[0] == "/talker"
    publishers = lines[lines.index("  Publishers:") + 1 : lines.index("  Service Servers:")]
    assert "    /test/chatter: std_msgs/msg/String" in publishers
    assert "    /talker/get_parameters: rcl_interfaces/srv/GetParameters" in lines


def test_parameters_are_listed_and_printed(ros2: Run) -> None:
    assert "  use_sim_time" in ros2("param", "list").stdout.splitlines()
    assert "/talker:" in ros2("param", "list").stdout.splitlines()
    assert "/talker:" not in ros2("param", "list", "/talker").stdout
    assert ros2("param", "get", "/talker", "use_sim_time").stdout == "Boolean value is: False\n"
    assert ros2("param", "get", "talker", "use_sim_time", "--hide-type").stdout == "False\n"


@pytest.mark.parametrize(
    ("words", "named"),
    [
        (["topic", "info", "/no/such", "--spin-time", "0.1"], "/no/such"),
        (["node", "info", "nobody"], "/nobody"),
        (["param", "get", "/talker", "no_such"], "no_such"),
        (["param", "list", "/nobody"], "/nobody"),
    ],
)
def test_what_is_not_there_gets_one_line(ros2: Run, words: list[str], named: str) -> None:
    result = ros2(*words)
    assert result.returncode == 1
    assert result.stderr.count("\n") == 1
    assert named in result.stderr


def test_definitions_are_printed_with_the_types_in_them(ros2: Run) -> None:
    lines = ros2("interface", "show", "siren_msgs/msg/AvControl").stdout.splitlines()
    assert "\tint32 sec" in lines
    service = ros2("interface", "show", "rosbag2_interfaces/srv/Seek").stdout.splitlines()
    assert service[0] == "builtin_interfaces/Time time"
    assert "---" in service
    listing = ros2("interface", "list", "siren_msgs").stdout.splitlines()
    assert "siren_msgs/msg/AvControl" in listing
