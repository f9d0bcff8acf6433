"""`ros2 bag`: a bag written by rosbags, described and played to a real subscriber."""

import signal
import subprocess
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from environment_support import TIMEOUT_S, running
from program_output import next_line
from rosbags.interfaces import Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

Run = Callable[..., "subprocess.CompletedProcess[str]"]
Refused = Callable[..., None]
Start = Callable[..., "subprocess.Popen[str]"]

pytestmark = pytest.mark.timeout(60)

NS_PER_S = 1_000_000_000
STEPS = 20
STEP_NS = 50_000_000
DELAY_S = "2"
"""For discovery, before the first message."""
STORE = get_typestore(Stores.ROS2_JAZZY)
ENDLESS = QosTime(9223372036, 854775807)


def offer(durability: QosDurability) -> Qos:
    return Qos(
        QosHistory.KEEP_LAST, 10, QosReliability.RELIABLE, durability, ENDLESS, ENDLESS,
        QosLiveliness.AUTOMATIC, ENDLESS, avoid_ros_namespace_conventions=False,
    )  # fmt: skip


@pytest.fixture
def bag(tmp_path: Path) -> Path:
    """One second of a counter at 20 Hz, a recorded clock, and one latched message at the beginning."""
    path = tmp_path / "episode"
    string, number, clock = "std_msgs/msg/String", "std_msgs/msg/Int32", "rosgraph_msgs/msg/Clock"
    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        volatile, latched = offer(QosDurability.VOLATILE), offer(QosDurability.TRANSIENT_LOCAL)
        described = writer.add_connection("/bag/about", string, typestore=STORE, offered_qos_profiles=[latched])
        counter = writer.add_connection("/bag/count", number, typestore=STORE, offered_qos_profiles=[volatile])
        ticks = writer.add_connection("/clock", clock, typestore=STORE, offered_qos_profiles=[volatile])
        about = STORE.types[string](data="an episode")
        writer.write(described, NS_PER_S, bytes(STORE.serialize_cdr(about, string)))
        for step in range(STEPS):
            stamp_ns = NS_PER_S + step * STEP_NS
            time = STORE.types["builtin_interfaces/msg/Time"](*divmod(stamp_ns, NS_PER_S))
            writer.write(counter, stamp_ns, bytes(STORE.serialize_cdr(STORE.types[number](data=step), number)))
            writer.write(ticks, stamp_ns, bytes(STORE.serialize_cdr(STORE.types[clock](clock=time), clock)))
    return path


LISTENER = """
import rclpy
from rclpy.qos import DurabilityPolicy, QoSProfile
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Int32, String

rclpy.init()
node = rclpy.create_node("listener")
def say(*words):
    print(*words, flush=True)
node.create_subscription(Int32, "/bag/count", lambda m: say("count", node.get_clock().now().nanoseconds, m.data), 100)
node.create_subscription(Clock, "/clock", lambda m: say("clock", m.clock.sec * 10**9 + m.clock.nanosec), 100)
latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
node.create_subscription(String, "/bag/about", lambda m: say("about", m.data), latched)
print("ready", flush=True)
rclpy.spin(node)
"""


@contextmanager
def listening(domain_id: str) -> Iterator[Callable[[int], list[list[str]]]]:
    """A subscriber in another process; hands over the next lines of what it hears, as words."""
    pytest.importorskip("rclpy", reason="needs ROS")
    with running(LISTENER, domain_id) as listener:
        yield lambda count: [next_line(listener.stdout).rstrip().split(maxsplit=2) for _ in range(count)]


def heard(start_ros2: Start, domain_id: str, *words: str, lines: int) -> tuple[list[list[str]], int]:
    """What a subscriber hears of `ros2 bag play`, and play's exit code."""
    with listening(domain_id) as hear:
        player = start_ros2("bag", "play", *words, "--delay", DELAY_S)
        return hear(lines), player.wait(timeout=TIMEOUT_S)


def values(received: list[list[str]], kind: str, column: int = 1) -> list[int]:
    return [int(words[column]) for words in received if words[0] == kind]


def test_info_tells_what_the_bag_holds(ros2: Run, bag: Path) -> None:
    result = ros2("bag", "info", str(bag))
    assert result.returncode == 0
    lines = {line.split(":")[0]: line.split(":", 1)[1].strip() for line in result.stdout.splitlines()[:8]}
    assert lines["Files"] == "episode.mcap"
    assert lines["Storage id"] == "mcap"
    assert lines["Messages"] == str(2 * STEPS + 1)
    assert float(lines["Duration"].removesuffix("s")) == pytest.approx((STEPS - 1) * STEP_NS / NS_PER_S, abs=1e-6)
    assert "Topic: /bag/count | Type: std_msgs/msg/Int32 | Count: 20 | Serialization Format: cdr" in result.stdout


def test_info_of_a_damaged_bag_is_one_line(refused: Refused, bag: Path) -> None:
    (bag / "metadata.yaml").write_text("nothing")
    refused(["bag", "info", str(bag)], 1, str(bag))


def test_play_keeps_order_content_and_timing(start_ros2: Start, domain_id: str, bag: Path) -> None:
    received, exit_code = heard(start_ros2, domain_id, str(bag), lines=2 * STEPS + 1)
    assert exit_code == 0
    assert ["about", "an", "episode"] in received
    assert values(received, "count", 2) == list(range(STEPS))
    assert values(received, "clock") == [NS_PER_S + step * STEP_NS for step in range(STEPS)]
    arrivals_ns = values(received, "count")
    # Every message waits for its time, so the whole takes as long as the recording, less what the first one is late.
    assert arrivals_ns[-1] - arrivals_ns[0] > 0.6 * (STEPS - 1) * STEP_NS


def test_play_from_an_offset_with_an_own_clock_some_topics(start_ros2: Start, domain_id: str, bag: Path) -> None:
    options = ["--start-offset", "0.5", "-r", "4", "--topics", "/bag/count", "--clock", "100"]
    ticks = STEPS // 2 * 5 - 4
    received, exit_code = heard(start_ros2, domain_id, str(bag), *options, lines=STEPS // 2 + ticks)
    assert exit_code == 0
    assert values(received, "clock") == [NS_PER_S + (50 + tick) * 10_000_000 for tick in range(ticks)]
    assert values(received, "count", 2) == list(range(STEPS // 2, STEPS))


def test_play_again_and_again(start_ros2: Start, domain_id: str, bag: Path) -> None:
    with listening(domain_id) as hear:
        player = start_ros2("bag", "play", str(bag), "-l", "-r", "10", "--topics", "/bag/count", "--delay", DELAY_S)
        assert values(hear(2 * STEPS + 1), "count", 2) == [*range(STEPS), *range(STEPS), 0]
        player.send_signal(signal.SIGINT)
        player.communicate(timeout=TIMEOUT_S)
        assert player.returncode == 130


def test_an_unknown_topic_is_named(refused: Refused, bag: Path) -> None:
    pytest.importorskip("rclpy", reason="needs ROS")
    refused(["bag", "play", str(bag), "--topics", "/no/such"], 2, "/no/such")
