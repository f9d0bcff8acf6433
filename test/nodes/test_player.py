"""A played bag is, to a subscriber, the live run: the same bytes, topics, order, types and quality of service."""

import hashlib
import json
import signal
import subprocess
import sys
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path

import pytest
from live_episodes import Domain, wait_until
from program_output import next_line

from siren_ros.recording.bag_reader import open_bag

DOMAIN = Domain()

LISTENER = """
import hashlib, json, sys, time
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile
from siren_ros.ros.transport.endpoints import message_class
wanted, late = json.loads(sys.argv[1]), sys.argv[2] == "late"
depth, busy_s = (int(sys.argv[3]), float(sys.argv[4])) if len(sys.argv) > 3 else (1000, 0.0)
rclpy.init()
node = rclpy.create_node("listener")
seen = {name: [] for name in wanted}
if late:
    while not node.count_publishers("/siren/map"):
        time.sleep(0.01)
    time.sleep(0.5)
for name, (kind, latched) in wanted.items():
    qos = QoSProfile(depth=depth) if depth else QoSProfile(history=HistoryPolicy.KEEP_ALL)
    if latched:
        qos.durability = DurabilityPolicy.TRANSIENT_LOCAL
    def hear(cdr, name=name):
        seen[name].append(hashlib.sha256(cdr).hexdigest())
        time.sleep(busy_s)
    node.create_subscription(message_class(kind), name, hear, qos, raw=True)
executor = SingleThreadedExecutor()
executor.add_node(node)
print("listening", flush=True)
idle_s, heard = time.monotonic(), 0
while time.monotonic() - idle_s < (2.5 if heard else 30.0):
    executor.spin_once(timeout_sec=0.1)
    if sum(map(len, seen.values())) != heard:
        heard, idle_s = sum(map(len, seen.values())), time.monotonic()
        print("heard", heard, flush=True)
print(json.dumps(seen))
"""


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A real episode, of one second, with two sensors' worth of topics."""
    folder = tmp_path_factory.mktemp("played")
    done = DOMAIN.run("template:=S2", "duration_s:=1.0", "sensors:=lidar", "kitti:=false", "bag:=bag", cwd=folder)
    assert done.code == 0, done.err
    return folder / "bag"


def recorded(bag: Path, from_ns: int = 0) -> dict[str, list[str]]:
    """Hash of every message by topic, as a listener would see it."""
    with open_bag(bag) as opened:
        seen: dict[str, list[str]] = {name: [] for name in opened.type_names}
        for message in opened.messages():
            if message.time_ns >= from_ns or message.topic in opened.latched:
                seen[message.topic].append(hashlib.sha256(message.cdr).hexdigest())
    return seen


def wanted_of(bag: Path) -> str:
    """What a listener is told to subscribe to."""
    with open_bag(bag) as opened:
        return json.dumps({name: (kind, name in opened.latched) for name, kind in opened.type_names.items()})


def play(bag: Path, *parameters: str) -> list[str]:
    flags = [part for item in (f"bag:={bag}", *parameters) for part in ("-p", item)]
    return ["-m", "siren_nodes.player", "--ros-args", *flags]


def heard(bag: Path, *parameters: str, listener_options: Sequence[str] = ()) -> dict[str, list[str]]:
    """What a subscriber of all topics hears that was there before the first message."""
    with DOMAIN.running("-c", LISTENER, wanted_of(bag), "early", *listener_options, cwd=bag.parent) as listener:
        assert next_line(listener.stdout) == "listening\n"
        with DOMAIN.running(*play(bag, *parameters), cwd=bag.parent) as playing:
            assert playing.wait(60.0) == 0
        return messages_of(listener)


def heard_late(bag: Path, count: int) -> list[dict[str, list[str]]]:
    """What subscribers hear that come one after the other while the bag is played."""
    arguments = ("-c", LISTENER, wanted_of(bag), "late")
    with DOMAIN.running(*play(bag, "delay_s:=0.0", "rate:=0.1"), cwd=bag.parent), ExitStack() as stack:
        listeners = []
        for _ in range(count):
            listeners.append(stack.enter_context(DOMAIN.running(*arguments, cwd=bag.parent)))
            assert next_line(listeners[-1].stdout) == "listening\n"
        return [messages_of(listener) for listener in listeners]


def messages_of(listener: "subprocess.Popen[str]") -> dict[str, list[str]]:
    out, err = listener.communicate(timeout=90.0)
    assert not err, err
    seen: dict[str, list[str]] = json.loads(out.splitlines()[-1])
    return seen


def test_a_subscriber_gets_every_byte_in_order(bag: Path) -> None:
    assert heard(bag, "delay_s:=5.0", "rate:=0.5") == recorded(bag)


@pytest.mark.parametrize("history", ["as long as the topic", "KEEP_ALL"])
def test_a_slow_subscriber_gets_everything_that_its_queue_can_hold(bag: Path, history: str) -> None:
    """It needs 10 ms for each message, and so longer for all of them than the player does."""
    everything = recorded(bag)
    depth = 0 if history == "KEEP_ALL" else max(len(hashes) for hashes in everything.values())
    assert heard(bag, "delay_s:=5.0", listener_options=(str(depth), "0.01")) == everything


def test_from_the_middle_latched_topics_are_there_too(bag: Path) -> None:
    assert heard(bag, "delay_s:=5.0", "start_s:=0.5", "rate:=0.5") == recorded(bag, 500_000_000)


def test_late_subscribers_get_everything_from_their_joining_on(bag: Path) -> None:
    everything = recorded(bag)
    for seen in heard_late(bag, 3):
        for topic in ("/siren/map", "/siren/episode", "/tf_static", "/siren/outcome"):
            assert seen[topic] == everything[topic]
        for topic, bytes_heard in seen.items():
            assert bytes_heard == everything[topic][-len(bytes_heard) :], topic
        assert 0 < len(seen["/clock"]) < len(everything["/clock"])
        assert len(seen["/emv/lidar/points"]) > 0


def test_a_subscriber_that_hangs_stops_the_player_for_a_while_only(bag: Path) -> None:
    with DOMAIN.running("-c", LISTENER, wanted_of(bag), "early", cwd=bag.parent) as listener:
        assert next_line(listener.stdout) == "listening\n"
        with DOMAIN.running(*play(bag, "delay_s:=5.0"), cwd=bag.parent) as playing:
            wait_until(lambda: "heard" in next_line(listener.stdout))
            listener.send_signal(signal.SIGSTOP)
            assert playing.wait(90.0) == 0
            assert playing.stderr is not None
            assert "a subscriber does not answer" in playing.stderr.read()


CALLER = """
import sys, time
import rclpy
from rosgraph_msgs.msg import Clock
from std_srvs.srv import Trigger
rclpy.init()
node = rclpy.create_node("caller")
steps = []
hear = lambda message: steps.append(round((message.clock.sec + message.clock.nanosec * 1e-9) * 20))
node.create_subscription(Clock, "/clock", hear, 100)
def call(service):
    client = node.create_client(Trigger, "/player/" + service)
    assert client.wait_for_service(30.0)
    future = client.call_async(Trigger.Request())
    rclpy.spin_until_future_complete(node, future, timeout_sec=10.0)
    assert future.result().success
    return future.result().message
def listen(seconds):
    until = time.monotonic() + seconds
    while time.monotonic() < until:
        rclpy.spin_once(node, timeout_sec=0.05)
listen(1.5)
assert not steps, "it waits"
call("resume")
while len(steps) < 30:
    rclpy.spin_once(node, timeout_sec=0.1)
assert steps[:30] == [*range(20), *range(10)], steps
print(call("pause"))
listen(0.3)
count = len(steps)
listen(1.0)
assert len(steps) == count, "it stands still"
assert call("toggle_paused").startswith("playing at ")
while len(steps) == count:
    rclpy.spin_once(node, timeout_sec=0.1)
print("done")
"""


def test_it_pauses_and_loops(bag: Path) -> None:
    flags = ("-p", f"bag:={bag}", "-p", "loop:=true", "-p", "paused:=true", "-p", "delay_s:=0.0")
    with (
        DOMAIN.running("-m", "siren_nodes.player", "--ros-args", *flags, cwd=bag.parent),
        DOMAIN.running("-c", CALLER, cwd=bag.parent) as caller,
    ):
        out, err = caller.communicate(timeout=90.0)
    assert not err, err
    assert out.splitlines()[0].startswith("paused at ")
    assert out.splitlines()[-1] == "done"


@pytest.mark.parametrize(
    ("bag_name", "parameter", "named"),
    [("nothing", "rate:=1.0", "nothing"), ("bag", "rate:=-1.0", "rate: -1.0"), ("bag", "loop:=perhaps", "loop")],
)
def test_bad_input_gets_one_line(bag: Path, bag_name: str, parameter: str, named: str) -> None:
    flags = ("-p", f"bag:={bag.parent / bag_name}", "-p", parameter)
    with DOMAIN.running("-m", "siren_nodes.player", "--ros-args", *flags, cwd=bag.parent) as player:
        _, err = player.communicate(timeout=60.0)
    assert player.returncode == 2
    (line,) = err.splitlines()
    assert named in line


def test_two_players_in_one_domain_are_refused(bag: Path) -> None:
    flags = ("-p", f"bag:={bag}", "-p", "delay_s:=60.0")
    command = ("-m", "siren_nodes.player", "--ros-args", *flags)
    with (
        DOMAIN.running(*command, cwd=bag.parent),
        DOMAIN.running("-c", LISTENER, "{}", "late", cwd=bag.parent) as probe,
    ):
        assert next_line(probe.stdout)
        with DOMAIN.running(*command, cwd=bag.parent) as second:
            _, err = second.communicate(timeout=60.0)
    assert second.returncode == 2
    assert "ROS_DOMAIN_ID" in err


def test_siren_replay_is_the_player(bag: Path) -> None:
    command = [sys.executable, "-m", "siren_ros.cli.main", "replay", str(bag), "--rate", "20"]
    done = subprocess.run(command, env=DOMAIN.environment, capture_output=True, text=True, timeout=60.0, check=False)
    assert (done.returncode, done.stderr) == (0, "")
