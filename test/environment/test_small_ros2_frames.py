"""`tf2_echo` and `view_frames` of the small ros2: poses by formulas, and beside a real broadcaster."""

import os
import re
import signal
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from environment_support import running
from program_output import next_line

rclpy = pytest.importorskip("rclpy", reason="needs ROS")

from small_ros2.tf2_echo import text_of  # noqa: E402  the modules import rclpy
from small_ros2.topic import with_depth  # noqa: E402
from small_ros2.transforms import FrameTree, TransformError  # noqa: E402
from small_ros2.view_frames import dot_text, drawn, frame_data, places  # noqa: E402

Run = Callable[..., "subprocess.CompletedProcess[str]"]
Start = Callable[..., "subprocess.Popen[str]"]
S = 10**9


def transform(parent: str, child: str, stamp_ns: int, xyz: tuple[float, float, float], yaw_rad: float = 0.0) -> Any:
    return SimpleNamespace(
        header=SimpleNamespace(frame_id=parent, stamp=SimpleNamespace(sec=stamp_ns // S, nanosec=stamp_ns % S)),
        child_frame_id=child,
        transform=SimpleNamespace(
            translation=SimpleNamespace(x=xyz[0], y=xyz[1], z=xyz[2]),
            rotation=SimpleNamespace(x=0.0, y=0.0, z=np.sin(yaw_rad / 2.0), w=np.cos(yaw_rad / 2.0)),
        ),
    )


def tree_of(*moving: Any, static: tuple[Any, ...] = ()) -> FrameTree:
    tree = FrameTree()
    tree.add(SimpleNamespace(transforms=list(static)), static=True)
    for link in moving:
        tree.add(SimpleNamespace(transforms=[link]))
    return tree


QUARTER = np.pi / 2.0


def test_a_chain_of_frames_gives_the_pose_of_its_end() -> None:
    """Two m ahead of a vehicle that heads north at (10, 5), which is where the LiDAR sits; and the way back."""
    lidar = transform("base_link", "lidar", 0, (2.0, 0.0, 1.9), -QUARTER)
    tree = tree_of(
        transform("map", "odom", 3 * S, (10.0, 0.0, 0.0)),
        transform("odom", "base_link", 3 * S, (0.0, 5.0, 0.0), QUARTER),
        static=(lidar,),
    )
    pose = tree.latest("map", "lidar")
    assert (pose.stamp_ns, pose.translation) == (3 * S, pytest.approx([10.0, 7.0, 1.9]))
    assert pose.rotation.as_euler("ZYX") == pytest.approx([0.0, 0.0, 0.0], abs=1e-12)
    back = tree.latest("lidar", "map")
    assert back.translation == pytest.approx([-10.0, -7.0, -1.9])
    assert tree.latest("base_link", "lidar").stamp_ns == 0
    assert tree.latest("map", "map").translation == pytest.approx([0.0, 0.0, 0.0])


def test_the_latest_time_is_one_that_all_links_have() -> None:
    """The vehicle's pose is known until 4 s, the map's until 3.5 s: half-way between two poses."""
    tree = tree_of(
        transform("odom", "base_link", 3 * S, (1.0, 0.0, 0.0), 0.0),
        transform("odom", "base_link", 4 * S, (2.0, 0.0, 0.0), QUARTER),
        transform("map", "odom", 3 * S + S // 2, (0.0, 0.0, 0.0)),
    )
    pose = tree.latest("map", "base_link")
    assert (pose.stamp_ns, pose.translation) == (3 * S + S // 2, pytest.approx([1.5, 0.0, 0.0]))
    assert pose.rotation.as_euler("ZYX")[0] == pytest.approx(QUARTER / 2.0)
    early = tree_of(
        transform("odom", "base_link", 4 * S, (1.0, 0.0, 0.0)), transform("map", "odom", 3 * S, (0.0, 0.0, 0.0))
    )
    with pytest.raises(TransformError, match=r"into the past.*time 3\.0.*earliest data is at time 4\.0"):
        early.latest("map", "base_link")


def test_what_is_missing_is_said_in_tf2s_words() -> None:
    tree = tree_of(transform("map", "odom", S, (0.0, 0.0, 0.0)), transform("a", "b", S, (0.0, 0.0, 0.0)))
    for target, source, message in (
        ("no", "map", 'Invalid frame ID "no" passed to canTransform argument target_frame'),
        ("map", "no", 'Invalid frame ID "no" passed to canTransform argument source_frame'),
        ("/map", "odom", "cannot start with a '/'"),
        ("map", "b", "not part of the same tree"),
    ):
        with pytest.raises(TransformError, match=re.escape(message)):
            tree.latest(target, source)


def test_ten_seconds_are_kept_and_a_time_counts_once() -> None:
    tree = tree_of(*(transform("map", "car", k * S, (float(k), 0.0, 0.0)) for k in (*range(13), 5, 1)))
    data = frame_data(tree)["car"]
    assert tree.latest("map", "car").translation[0] == 12.0
    assert (data["oldest_transform"], data["most_recent_transform"], data["buffer_length"]) == (2.0, 12.0, 10.0)
    assert data["rate"] == pytest.approx(11 / 10.0)


def test_a_transform_is_printed_as_tf2_echo_prints_it() -> None:
    tree = tree_of(transform("map", "car", 12 * S + 50_000_000, (1.0, -2.5, 0.0), QUARTER))
    assert text_of(tree.latest("map", "car"), 3).splitlines() == [
        "At time 12.050000000",
        "- Translation: [1.000, -2.500, 0.000]",
        "- Rotation: in Quaternion (xyzw) [0.000, 0.000, 0.707, 0.707]",
        "- Rotation: in RPY (radian) [0.000, 0.000, 1.571]",
        "- Rotation: in RPY (degree) [0.000, 0.000, 90.000]",
        "- Matrix:",
        "  0.000 -1.000  0.000  1.000",
        "  1.000  0.000  0.000 -2.500",
        "  0.000  0.000  1.000  0.000",
        "  0.000  0.000  0.000  1.000",
    ]


def test_the_tree_is_written_as_view_frames_writes_it(tmp_path: Path) -> None:
    static = transform("base_link", "lidar", 0, (2.0, 0.0, 1.9))
    tree = tree_of(*(transform("map", "base_link", k * S // 20, (0.0, 0.0, 0.0)) for k in range(21)), static=(static,))
    data = frame_data(tree)
    lines = dot_text(data, 7.5).splitlines()
    assert lines[2].startswith('"map" -> "base_link"[label=" Broadcaster: default_authority\\nAverage rate: 21.0\\n')
    assert lines[1].startswith('"base_link" -> "lidar"[label=" Broadcaster: default_authority\\nAverage rate: 10000.0')
    assert dot_text({}, 0.0) == 'digraph G { "No tf data received" }'
    assert places(data) == {"map": (0.0, 0), "base_link": (0.0, 1), "lidar": (0.0, 2)}
    for number, content in enumerate((data, {})):
        drawn(content, 7.5).savefig(tmp_path / f"{number}.pdf")
        assert (tmp_path / f"{number}.pdf").read_bytes().startswith(b"%PDF")


@pytest.mark.parametrize(
    ("node", "topic", "type_name", "depth"),
    [
        ("vehicle_dynamics", "/siren/actor_states", "siren_msgs/msg/ActorStates", 8),
        ("sensor_sim", "/emv/front_left/points", "sensor_msgs/msg/PointCloud2", 8),
        ("sensor_sim", "/av/odom", "nav_msgs/msg/Odometry", 8),
        ("cosim", "/siren/step_done", "siren_msgs/msg/StepDone", 64),
        ("sumo_bridge", "/siren/map", "std_msgs/msg/String", 1),
        ("rviz", "/siren/map", "std_msgs/msg/String", None),
        ("sumo_bridge", "/siren/map", "std_msgs/msg/Int32", None),
        ("sumo_bridge", "/siren/map/more", "std_msgs/msg/String", None),
        ("recorder", "/rosout", "rcl_interfaces/msg/Log", None),
    ],
)
def test_the_depth_of_our_own_nodes_is_known(node: str, topic: str, type_name: str, depth: int | None) -> None:
    from rclpy.qos import HistoryPolicy

    quality = SimpleNamespace(history=HistoryPolicy.UNKNOWN, depth=0)
    endpoint: Any = SimpleNamespace(node_name=node, topic_type=type_name, qos_profile=quality)
    with_depth(endpoint, topic)
    expected = (HistoryPolicy.UNKNOWN, 0) if depth is None else (HistoryPolicy.KEEP_LAST, depth)
    assert (quality.history, quality.depth) == expected


BROADCASTER = """
import rclpy
from geometry_msgs.msg import TransformStamped
from rclpy.node import Node
from siren_ros.data.interfaces import topics
from siren_ros.running.ros.transport.endpoints import qos_of
from std_msgs.msg import String
from tf2_msgs.msg import TFMessage
rclpy.init()
node = Node("sensor_sim")
sensing = node.create_publisher(String, topics.SENSING.name, qos_of(topics.SENSING))
moving = node.create_publisher(TFMessage, "/tf", 10)
fixed = node.create_publisher(TFMessage, "/tf_static", qos_of(topics.TF_STATIC))
def message(parent, child, x):
    link = TransformStamped()
    link.header.frame_id, link.child_frame_id = parent, child
    link.header.stamp.sec = 4
    link.transform.translation.x, link.transform.rotation.w = x, 1.0
    return TFMessage(transforms=[link])
fixed.publish(message("base_link", "lidar", 2.0))
node.create_timer(0.05, lambda: moving.publish(message("map", "base_link", 10.0)))
print("ready", flush=True)
rclpy.spin(node)
"""


@pytest.fixture(scope="module")
def broadcaster(domain_id: str) -> Iterator[None]:
    with running(BROADCASTER, domain_id):
        yield


@pytest.mark.timeout(90)
@pytest.mark.usefixtures("broadcaster")
def test_frames_of_a_live_broadcaster(ros2: Run, start_ros2: Start, tmp_path: Path) -> None:
    """Ctrl-C ends tf2_echo as it ends the real one."""
    echo = start_ros2("run", "tf2_ros", "tf2_echo", "map", "lidar", "10", "2")
    assert [next_line(echo.stdout) for _ in range(2)] == [
        "At time 4.000000000\n",
        "- Translation: [12.00, 0.00, 0.00]\n",
    ]
    os.killpg(echo.pid, signal.SIGINT)
    _, errors = echo.communicate(timeout=20)
    assert (echo.returncode, "Traceback" in errors) == (0, False)
    name = str(tmp_path / "tree")
    assert ros2("run", "tf2_tools", "view_frames", "-t", "2", "-o", name).returncode == 0
    text = Path(f"{name}.gv").read_text()
    assert '"map" -> "base_link"[label=' in text
    assert '"base_link" -> "lidar"[label=' in text
    assert Path(f"{name}.pdf").read_bytes().startswith(b"%PDF")
    assert "History (Depth): KEEP_LAST (1)" in ros2("topic", "info", "/siren/sensing", "-v").stdout


@pytest.mark.parametrize(
    ("words", "code", "named"),
    [
        (["tf2_ros", "tf2_echo", "map"], 2, "target_frame"),
        (["tf2_ros", "tf2_echo", "map", "odom", "0"], 2, "echo_rate"),
        (["tf2_tools", "view_frames", "-t", "-1"], 2, "--wait-time"),
        (["tf2_tools", "view_frames", "-t", "0", "-o", "/no/such/folder/x"], 1, "/no/such/folder"),
        (["tf2_ros", "static_transform_publisher"], 1, "tf2_echo"),
    ],
)
def test_a_wrong_call_is_one_line(refused: Callable[..., None], words: list[str], code: int, named: str) -> None:
    refused(["run", *words], code, named)
