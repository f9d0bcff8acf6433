"""A played bag is, to a subscriber, the live run: the same bytes, topics, order, types and quality of service."""

import hashlib
import json
import signal
import subprocess
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path

import pytest
from live_episodes import IN_ORDER, Domain, tell, wait_until
from program_output import next_line

from siren_ros.data.recording.bag_reader import open_bag
from siren_ros.running.ros.transport.dds import DOMAIN_VARIABLE, claimed_domain

DOMAIN = Domain()

LISTENER = """
import hashlib, json, sys, time
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile
from rosgraph_msgs.msg import Clock
from siren_ros.running.ros.transport.endpoints import message_class
wanted, late = json.loads(sys.argv[1]), sys.argv[2] == "late"
depth, busy_s = (int(sys.argv[3]), float(sys.argv[4])) if len(sys.argv) > 3 else (1000, 0.0)
rclpy.init()
node = rclpy.create_node("listener")
seen = {name: [] for name in wanted}
executor = SingleThreadedExecutor()
executor.add_node(node)
if late:
    sys.stdin.readline()
    early = node.create_subscription(Clock, "/clock", lambda cdr: seen["/clock"].append(cdr), 10, raw=True)
    while not seen["/clock"]:
        executor.spin_once(timeout_sec=0.1)
    node.destroy_subscription(early)
    seen["/clock"].clear()
for name, (kind, latched) in wanted.items():
    qos = QoSProfile(depth=depth) if depth else QoSProfile(history=HistoryPolicy.KEEP_ALL)
    if latched:
        qos.durability = DurabilityPolicy.TRANSIENT_LOCAL
    def hear(cdr, name=name):
        seen[name].append(hashlib.sha256(cdr).hexdigest())
        time.sleep(busy_s)
    node.create_subscription(message_class(kind), name, hear, qos, raw=True)
print("listening", flush=True)
idle_s, heard = time.monotonic(), 0
while time.monotonic() - idle_s < (0.5 if heard else 30.0) or heard and node.count_publishers("/clock"):
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


def recorded(bag: Path) -> dict[str, list[str]]:
    """Hash of every message by topic, as a listener would see it."""
    with open_bag(bag) as opened:
        seen: dict[str, list[str]] = {name: [] for name in opened.type_names}
        for message in opened.messages():
            seen[message.topic].append(hashlib.sha256(message.cdr).hexdigest())
    return seen


def wanted_of(bag: Path) -> str:
    """What a listener is told to subscribe to."""
    with open_bag(bag) as opened:
        return json.dumps({name: (kind, name in opened.latched) for name, kind in opened.type_names.items()})


def play(bag: Path, *parameters: str) -> list[str]:
    flags = [part for item in (f"bag:={bag}", *parameters) for part in ("-p", item)]
    return ["-m", "siren_nodes.player", "--ros-args", *flags]


def heard_by(listeners: Sequence[Sequence[str]], bag: Path, *command: str) -> list[dict[str, list[str]]]:
    """What subscribers of all topics hear that are there before the first message, each with its options."""
    with ExitStack() as stack:
        started = [
            stack.enter_context(DOMAIN.running("-c", LISTENER, wanted_of(bag), "early", *options, cwd=bag.parent))
            for options in listeners
        ]
        for listener in started:
            assert next_line(listener.stdout) == "listening\n"
        with DOMAIN.running(*command, cwd=bag.parent) as playing:
            assert playing.wait(60.0) in IN_ORDER
        return [messages_of(listener) for listener in started]


def messages_of(listener: "subprocess.Popen[str]") -> dict[str, list[str]]:
    out, err = listener.communicate(timeout=90.0)
    assert not err, err
    seen: dict[str, list[str]] = json.loads(out.splitlines()[-1])
    return seen


def test_subscribers_get_every_byte_in_order_also_slow_ones_and_under_another_name(bag: Path) -> None:
    """The slow ones need 10 ms for each message, and so longer for all of them than the player does."""
    everything = recorded(bag)
    depth = max(len(hashes) for hashes in everything.values())
    listeners = [(), (str(depth), "0.01"), ("0", "0.01")]
    remapped = [*play(bag, "delay_s:=5.0"), "-r", "/emv/odom:=/mine/odom"]
    assert heard_by(listeners, bag, *remapped) == [{**everything, "/emv/odom": []}] * 3


def test_a_late_subscriber_gets_everything_from_its_joining_on(bag: Path) -> None:
    everything, command = recorded(bag), play(bag, "delay_s:=3.0", "rate:=0.2")
    with (
        DOMAIN.running(*command, cwd=bag.parent),
        DOMAIN.running("-c", LISTENER, wanted_of(bag), "late", cwd=bag.parent) as listener,
    ):
        tell(listener)
        assert next_line(listener.stdout) == "listening\n"
        seen = messages_of(listener)
    for topic in ("/siren/map", "/siren/episode", "/tf_static", "/siren/episode_end", "/siren/outcome"):
        assert seen[topic] == everything[topic]
    for topic, bytes_heard in seen.items():
        assert bytes_heard == everything[topic][-len(bytes_heard) :], topic
    assert 0 < len(seen["/clock"]) < len(everything["/clock"])
    assert len(seen["/emv/lidar/points"]) > 0


IMPATIENT = """
from siren_ros.running.ros.transport import endpoints
endpoints.PATIENCE_S = 3.0
from siren_nodes.player import main
main()
"""


def test_a_subscriber_that_hangs_stops_the_player_for_a_while_only(bag: Path) -> None:
    with DOMAIN.running("-c", LISTENER, wanted_of(bag), "early", cwd=bag.parent) as listener:
        assert next_line(listener.stdout) == "listening\n"
        with DOMAIN.running("-c", IMPATIENT, *play(bag, "delay_s:=5.0")[2:], cwd=bag.parent) as playing:
            wait_until(lambda: "heard" in next_line(listener.stdout), listener)
            listener.send_signal(signal.SIGSTOP)
            assert playing.wait(90.0) in IN_ORDER
            assert playing.stderr is not None
            assert "a subscriber does not answer" in playing.stderr.read()


CALLER = """
import sys, time
import rclpy
from rclpy.qos import QoSProfile
from rosbag2_interfaces import srv
from rosgraph_msgs.msg import Clock
rclpy.init()
node = rclpy.create_node("caller")
steps = []
hear = lambda message: steps.append(round((message.clock.sec + message.clock.nanosec * 1e-9) * 20))
node.create_subscription(Clock, "/clock", hear, 1000)
clients = {}
def call(kind, service, **fields):
    if service not in clients:
        clients[service] = node.create_client(getattr(srv, kind), "/rosbag2_player/" + service)
    client = clients[service]
    assert client.wait_for_service(30.0)
    future = client.call_async(getattr(srv, kind).Request(**fields))
    rclpy.spin_until_future_complete(node, future, timeout_sec=30.0)
    return future.result()
def listen(seconds):
    until = time.monotonic() + seconds
    while time.monotonic() < until:
        rclpy.spin_once(node, timeout_sec=0.05)
def hear_until(step):
    until = time.monotonic() + 30.0
    while step not in steps and time.monotonic() < until:
        rclpy.spin_once(node, timeout_sec=0.1)
    assert step in steps, steps
"""

PAUSES = (
    CALLER
    + """
listen(1.5)
assert not steps, "it waits"
assert call("SetRate", "set_rate", rate=0.8).success
call("Resume", "resume")
while len(steps) < 30:
    rclpy.spin_once(node, timeout_sec=0.1)
assert steps[:30] == [*range(20), *range(10)], steps
assert call("GetRate", "get_rate").rate == 0.8, "as before the bag's end"
call("Pause", "pause")
assert call("IsPaused", "is_paused").paused
count = -1
while len(steps) != count:  # what was under way arrives
    count = len(steps)
    listen(0.5)
listen(0.5)
assert len(steps) == count, "it stands still"
call("TogglePaused", "toggle_paused")
assert not call("IsPaused", "is_paused").paused
while len(steps) == count:
    rclpy.spin_once(node, timeout_sec=0.1)
print("done")
"""
)

SEEKS = (
    CALLER
    + """
from builtin_interfaces.msg import Time
assert call("GetRate", "get_rate").rate == 1.0
assert call("SetRate", "set_rate", rate=2.5).success
assert not call("SetRate", "set_rate", rate=0.0).success
assert not call("SetRate", "set_rate", rate=-1.0).success
assert call("GetRate", "get_rate").rate == 2.5
assert call("Seek", "seek", time=Time(sec=0, nanosec=500_000_000)).success
assert not call("Seek", "seek", time=Time(sec=5)).success
assert call("Burst", "burst", num_messages=6).actually_burst == 6  # latched ones come first
steps.clear()
assert call("Seek", "seek", time=Time(sec=0, nanosec=250_000_000)).success
while not steps:
    assert call("PlayNext", "play_next").success
    listen(0.05)
assert steps == [5], steps
assert call("Burst", "burst", num_messages=0).actually_burst > 100
hear_until(19)
assert steps == [*range(5, 20)], steps
assert not call("PlayNext", "play_next").success
assert call("Seek", "seek", time=Time()).success
steps.clear()
call("Resume", "resume")
hear_until(19)
print("done")
"""
)


def control(bag: Path, program: str, *parameters: str) -> tuple[int, str]:
    """Exit code of a player that a program controls, and what the program printed."""
    flags = [part for item in (f"bag:={bag}", "paused:=true", "delay_s:=0.0", *parameters) for part in ("-p", item)]
    with (
        DOMAIN.running("-m", "siren_nodes.player", "--ros-args", *flags, cwd=bag.parent) as player,
        DOMAIN.running("-c", program, cwd=bag.parent) as caller,
    ):
        out, err = caller.communicate(timeout=120.0)
        assert not err, err
        if "loop:=true" not in parameters:
            assert player.wait(60.0) in IN_ORDER
        return caller.returncode, out


def test_it_pauses_and_loops(bag: Path) -> None:
    assert control(bag, PAUSES, "loop:=true") == (0, "done\n")


def test_rosbag2s_services_control_it(bag: Path) -> None:
    assert control(bag, SEEKS) == (0, "done\n")


def test_some_topics_for_a_while(bag: Path) -> None:
    everything = recorded(bag)
    topics = "topics:=[siren/events, siren/map]"
    parameters = (topics, "start_s:=0.25", "playback_duration_s:=0.5", "rate:=0.5", "delay_s:=5.0")
    (seen,) = heard_by([()], bag, *play(bag, *parameters))
    part = {name: everything[name][5:15] for name in ("/clock", "/siren/events")}
    assert {name: messages for name, messages in seen.items() if messages} == {
        **part,
        "/siren/map": everything["/siren/map"],  # it is latched
    }


@pytest.mark.parametrize(
    ("bag_name", "parameter", "named"),
    [("nothing", "rate:=1.0", "nothing"), ("bag", "topics:=[no/such]", "topics: '/no/such' cannot be used")],
)
def test_bad_input_gets_one_line(bag: Path, bag_name: str, parameter: str, named: str) -> None:
    flags = ("-p", f"bag:={bag.parent / bag_name}", "-p", parameter)
    with DOMAIN.running("-m", "siren_nodes.player", "--ros-args", *flags, cwd=bag.parent) as player:
        _, err = player.communicate(timeout=60.0)
    assert player.returncode == 2
    (line,) = err.splitlines()
    assert named in line


def test_a_player_in_a_domain_that_is_taken_is_refused(bag: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(DOMAIN_VARIABLE, str(DOMAIN.number))
    with claimed_domain(), DOMAIN.running(*play(bag), cwd=bag.parent) as player:
        _, err = player.communicate(timeout=60.0)
    assert player.returncode == 2
    assert "ROS_DOMAIN_ID" in err
