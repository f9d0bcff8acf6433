"""`ros2 topic`, `node`, `param` and `interface` next to real nodes in another process."""

import ast
import os
import re
import signal
import subprocess
from collections.abc import Callable

import numpy as np
import pytest
import yaml
from program_output import next_line

rclpy = pytest.importorskip("rclpy", reason="needs ROS")

Run = Callable[..., "subprocess.CompletedProcess[str]"]
Start = Callable[..., "subprocess.Popen[str]"]
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
        (["node", "info", "nobody", "--spin-time", "0.1"], "/nobody"),
        (["param", "get", "/talker", "no_such"], "no_such"),
        (["param", "list", "/nobody"], "/nobody"),
        (["topic", "echo", "/no/such/topic", "--spin-time", "0.1"], "/no/such/topic"),
        (["topic", "hz", "/no/such/topic", "--spin-time", "0.1"], "/no/such/topic"),
        (["topic", "echo", "/test/chatter", "no_msgs/msg/String"], "no_msgs/msg/String"),
        (["topic", "echo", "/test/chatter", "std_msgs/msg/NoSuch"], "std_msgs/msg/NoSuch"),
        (["topic", "echo", "/test/chatter", "String"], "String"),
    ],
)
def test_what_is_not_there_gets_one_line(refused: Callable[..., None], words: list[str], named: str) -> None:
    refused(words, 1, named)


def test_definitions_are_printed_with_the_types_in_them(ros2: Run) -> None:
    lines = ros2("interface", "show", "siren_msgs/msg/AvControl").stdout.splitlines()
    assert "\tint32 sec" in lines
    service = ros2("interface", "show", "rosbag2_interfaces/srv/Seek").stdout.splitlines()
    assert service[0] == "builtin_interfaces/Time time"
    assert "---" in service
    listing = ros2("interface", "list", "siren_msgs").stdout.splitlines()
    assert "siren_msgs/msg/AvControl" in listing


def test_list_shows_topics_and_types_and_not_itself(ros2: Run) -> None:
    lines = ros2("topic", "list", "-t").stdout.splitlines()
    assert "/test/chatter [std_msgs/msg/String]" in lines
    assert lines == sorted(lines)
    assert ros2("topic", "list").stdout.splitlines() == [line.split()[0] for line in lines]


def test_echo_gets_what_is_said_and_what_was_said_before_it_came(ros2: Run) -> None:
    assert ros2("topic", "echo", "/test/chatter", "--once").stdout == "data: grüezi\n---\n"
    assert ros2("topic", "echo", "test/latched", "--once").stdout == "data: said once\n---\n"


def test_echo_meets_best_effort_publishers_and_cuts_long_arrays(ros2: Run) -> None:
    short = yaml.safe_load(ros2("topic", "echo", "/test/unreliable", "--once").stdout.removesuffix("---\n"))
    assert short["data"] == [*range(128), "..."]
    whole = ros2("topic", "echo", "/test/unreliable", "--once", "--full-length").stdout.removesuffix("---\n")
    assert yaml.safe_load(whole)["data"] == list(range(200))


def test_echo_raw_prints_the_serialised_bytes(ros2: Run) -> None:
    from rclpy.serialization import deserialize_message  # the module skips where there is no ROS
    from std_msgs.msg import String

    text = ros2("topic", "echo", "/test/chatter", "--once", "--raw").stdout
    data = ast.literal_eval(text.removesuffix("---\n"))
    assert deserialize_message(data, String).data == "grüezi"


def test_echo_runs_until_ctrl_c(start_ros2: Start) -> None:
    process = start_ros2("topic", "echo", "/test/chatter")
    assert [next_line(process.stdout) for _ in range(4)] == ["data: grüezi\n", "---\n"] * 2
    os.killpg(process.pid, signal.SIGINT)
    _, errors = process.communicate(timeout=10)
    assert process.returncode == 130
    assert errors == ""


def test_hz_measures_the_rate(start_ros2: Start) -> None:
    process = start_ros2("topic", "hz", "/test/chatter")
    rate_hz = np.inf
    # The talker sleeps 20 ms between messages: it is slower, or faster until a late first message averages out.
    while not 0.0 < rate_hz <= 51.0:
        match = re.fullmatch(r"average rate: ([0-9.]+)\n", next_line(process.stdout))
        assert match is not None
        rate_hz = float(match[1])
        assert re.search(r"min: .*s max: .*s std dev: .*s window: \d+", next_line(process.stdout))
    os.killpg(process.pid, signal.SIGINT)
    process.communicate(timeout=10)
    assert process.returncode == 130


def test_rate_report_is_that_of_the_intervals() -> None:
    from collections import deque

    from small_ros2.topic import rate_report  # imports rclpy

    arrivals_s = np.array([0.0, 0.1, 0.2, 0.4])
    report = rate_report(deque(arrivals_s))
    deviation_s = np.sqrt(np.mean((np.array([0.1, 0.1, 0.2]) - 0.4 / 3.0) ** 2))
    assert report.startswith(f"average rate: {3.0 / 0.4:.3f}\n")
    assert report.endswith(f"min: 0.100s max: 0.200s std dev: {deviation_s:.5f}s window: 3")
