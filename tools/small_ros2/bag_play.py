"""``ros2 bag play``: publishes the recorded bytes on the recorded topics, at the recorded times."""

import argparse
import sys
import time
from enum import Enum
from typing import Any, Final

from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, HistoryPolicy, LivelinessPolicy, QoSProfile, ReliabilityPolicy
from rosbags.interfaces import Connection, ConnectionExtRosbag2, Qos, QosTime
from rosbags.rosbag2 import Reader

from small_ros2.bag_reading import open_bag
from small_ros2.errors import CommandError
from small_ros2.ros_graph import message_class, observer

NS_PER_S: Final = 1_000_000_000
CLOCK_TOPIC: Final = "/clock"
FLUSH_S: Final = 5.0
"""How long the end waits for subscribers to have everything."""
UNKNOWN_OFFER: Final = QoSProfile(depth=100)
INFINITE_SEC: Final = 2**31 - 1


def _duration(value: QosTime) -> Duration:
    """A recorded period; infinite ones are recorded as the largest number of seconds, absent ones as zero."""
    if value.sec >= INFINITE_SEC:
        return Duration()
    return Duration(seconds=value.sec, nanoseconds=value.nsec)


def _known(policy: Enum) -> str:
    """The policy's name; a recorder writes UNKNOWN where it does not know it, and no publisher can offer that."""
    return "SYSTEM_DEFAULT" if policy.name == "UNKNOWN" else policy.name


def offered_qos(recorded: Qos) -> QoSProfile:
    """The quality of service that a recorded publisher offered."""
    return QoSProfile(
        history=HistoryPolicy[_known(recorded.history)],
        depth=recorded.depth,
        reliability=ReliabilityPolicy[_known(recorded.reliability)],
        durability=DurabilityPolicy[_known(recorded.durability)],
        deadline=_duration(recorded.deadline),
        lifespan=_duration(recorded.lifespan),
        liveliness=LivelinessPolicy[_known(recorded.liveliness)],
        liveliness_lease_duration=_duration(recorded.liveliness_lease_duration),
    )


def qos_of(connection: Connection) -> QoSProfile:
    """Quality of service of a topic's publisher: that of the recorded publisher, if the bag contains it."""
    offers = connection.ext.offered_qos_profiles if isinstance(connection.ext, ConnectionExtRosbag2) else []
    return offered_qos(offers[0]) if offers else UNKNOWN_OFFER


def chosen_connections(reader: Reader, topics: list[str] | None, own_clock: bool) -> list[Connection]:
    """The recorded topics that are to be played.

    Raises:
        CommandError: A topic that the user names is not in the bag, or nothing is left to play.
    """
    known = {connection.topic for connection in reader.connections}
    unknown = sorted(set(topics or ()) - known)
    if unknown:
        raise CommandError(f"--topics: not in the bag: {', '.join(unknown)}; it has: {', '.join(sorted(known))}", 2)
    chosen = [
        connection
        for connection in reader.connections
        if (topics is None or connection.topic in topics) and not (own_clock and connection.topic == CLOCK_TOPIC)
    ]
    if not chosen or reader.message_count == 0:
        raise CommandError("the bag holds no messages to play")
    return chosen


class Player:
    """Publishes one bag, once or again and again."""

    def __init__(self, node: Node, reader: Reader, arguments: argparse.Namespace) -> None:
        self._reader = reader
        self._rate: float = arguments.rate
        self._start_ns = reader.start_time + round(arguments.start_offset * NS_PER_S)
        self._publishers: dict[int, Any] = {}
        self._connections: list[Connection] = []
        by_topic: dict[str, Any] = {}
        for connection in chosen_connections(reader, arguments.topics, arguments.clock is not None):
            if connection.topic not in by_topic:
                try:
                    message = message_class(connection.msgtype)
                except CommandError as error:
                    sys.stderr.write(f"ros2 bag: {connection.topic} is left out: {error}\n")
                    continue
                by_topic[connection.topic] = node.create_publisher(message, connection.topic, qos_of(connection))
            self._publishers[connection.id] = by_topic[connection.topic]
            self._connections.append(connection)
        if not self._connections:
            raise CommandError("none of the bag's message types is installed")
        self._clock = (
            node.create_publisher(message_class("rosgraph_msgs/msg/Clock"), CLOCK_TOPIC, 10)
            if arguments.clock
            else None
        )
        self._clock_period_ns = round(NS_PER_S / arguments.clock) if arguments.clock else 0

    def play_once(self) -> int:
        """Publishes every chosen message when its time has come; returns how many there were."""
        count = 0
        began_s = time.monotonic()
        next_clock_ns = self._start_ns
        for connection, stamp_ns, data in self._reader.messages(self._connections, start=self._start_ns):
            while self._clock is not None and next_clock_ns <= stamp_ns:
                self._wait_for(next_clock_ns, began_s)
                self._publish_clock(next_clock_ns)
                next_clock_ns += self._clock_period_ns
            self._wait_for(stamp_ns, began_s)
            self._publishers[connection.id].publish(bytes(data))
            count += 1
        return count

    def flush(self) -> None:
        """Waits until reliable subscribers have everything."""
        for publisher in self._publishers.values():
            publisher.wait_for_all_acked(Duration(seconds=FLUSH_S))

    def _wait_for(self, stamp_ns: int, began_s: float) -> None:
        due_s = began_s + (stamp_ns - self._start_ns) / NS_PER_S / self._rate
        remaining_s = due_s - time.monotonic()
        if remaining_s > 0.0:
            time.sleep(remaining_s)

    def _publish_clock(self, time_ns: int) -> None:
        message = message_class("rosgraph_msgs/msg/Clock")()
        message.clock.sec, message.clock.nanosec = divmod(time_ns, NS_PER_S)
        if self._clock is not None:
            self._clock.publish(message)


def play(arguments: argparse.Namespace) -> int:
    """Plays a bag to its end, or until Ctrl-C where it loops."""
    with open_bag(arguments.bag) as reader, observer("small_ros2_bag_play") as node:
        player = Player(node, reader, arguments)
        time.sleep(arguments.delay)
        while player.play_once() and arguments.loop:
            pass
        player.flush()
    return 0
