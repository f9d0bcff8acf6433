"""A node that observes the ROS graph: its topics, their types, and the quality of service that matches them."""

import importlib
import signal
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, Final

import rclpy
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.signals import SignalHandlerOptions

from siren_ros.errors import InputError
from siren_ros.running.ros.programs.program import choose_log_folder
from small_ros2.errors import CommandError

DISCOVERY_S: Final = 4.0
"""Time in which a new node finds the others. By default they announce themselves every 3 s."""
QUIET_S: Final = 0.7
"""A graph that has topics and has not changed for this time counts as complete."""
POLL_S: Final = 0.05
DEPTH: Final = 100


@contextmanager
def observer(name: str, words: Sequence[str] = ()) -> Iterator[Node]:
    """A node without topics of its own, so that it does not show up in what it lists.

    ``words`` is the command line that its ``--ros-args`` are taken from. Ctrl-C stays Python's KeyboardInterrupt;
    waiting in pieces of POLL_S lets it through.
    """
    try:
        choose_log_folder()
    except InputError as error:
        raise CommandError(str(error), exit_code=error.exit_code) from error
    rclpy.init(args=[name, *words], signal_handler_options=SignalHandlerOptions.NO)
    node = Node(name, enable_rosout=False, start_parameter_services=False)
    try:
        yield node
    finally:
        node.destroy_node()
        rclpy.shutdown()


def _topics(node: Node) -> dict[str, list[str]]:
    """The topics found so far, without those that every node has."""
    return {
        name: types
        for name, types in node.get_topic_names_and_types()
        if name != "/parameter_events" or node.count_publishers(name) > 1
    }


def discovered_topics(node: Node, discovery_s: float) -> dict[str, list[str]]:
    """Topic names and types of the graph, once it has become quiet or the time is over."""
    deadline_s = time.monotonic() + discovery_s
    topics: dict[str, list[str]] = {}
    changed_s = time.monotonic()
    while (now_s := time.monotonic()) < deadline_s and not (topics and now_s - changed_s > QUIET_S):
        time.sleep(POLL_S)
        present = _topics(node)
        if present != topics:
            topics, changed_s = present, time.monotonic()
    return topics


def discovered_nodes(node: Node, discovery_s: float) -> set[str]:
    """Full names of the other nodes, once the graph has become quiet or the time is over."""

    def present() -> set[str]:
        names = {f"{namespace.rstrip('/')}/{name}" for name, namespace in node.get_node_names_and_namespaces()}
        return names - {node.get_fully_qualified_name()}

    deadline_s = time.monotonic() + discovery_s
    names: set[str] = set()
    changed_s = time.monotonic()
    while (now_s := time.monotonic()) < deadline_s and not (names and now_s - changed_s > QUIET_S):
        time.sleep(POLL_S)
        if present() != names:
            names, changed_s = present(), time.monotonic()
    return names


def node_named(node: Node, name: str, discovery_s: float) -> str:
    """The full name of a node, once it is there and its topics are known.

    Raises:
        CommandError: It does not appear within the time; the message lists the nodes there are.
    """
    full = name if name.startswith("/") else f"/{name}"
    names = discovered_nodes(node, discovery_s)
    if full not in names:
        raise CommandError(f"node '{full}' is not there; there are: {', '.join(sorted(names)) or 'none'}")
    return full


def type_of_topic(node: Node, topic: str, discovery_s: float) -> str:
    """The type of a topic, as soon as somebody is found to publish or read it.

    Raises:
        CommandError: Nobody does within the time, or they disagree about its type.
    """
    deadline = time.monotonic() + discovery_s
    while True:
        types = dict(node.get_topic_names_and_types()).get(topic, [])
        if len(types) == 1:
            return str(types[0])
        if types:
            raise CommandError(f"topic '{topic}' has several types: {', '.join(sorted(types))}; name one")
        if time.monotonic() >= deadline:
            raise CommandError(
                f"topic '{topic}' is not published, so its type is unknown; name the type to wait for it"
            )
        time.sleep(POLL_S)


def message_class(type_name: str) -> Any:
    """The class of a message type such as ``std_msgs/msg/String``; ``std_msgs/String`` is understood too.

    Raises:
        CommandError: The name is no message type's, or its package is not installed.
    """
    parts = type_name.split("/")
    package, name = parts[0], parts[-1]
    if len(parts) not in (2, 3) or parts[1:-1] not in ([], ["msg"]) or not all(part.isidentifier() for part in parts):
        raise CommandError(f"'{type_name}' is not a message type such as std_msgs/msg/String")
    try:
        return getattr(importlib.import_module(f"{package}.msg"), name)
    except (ImportError, AttributeError):
        raise CommandError(f"message type '{type_name}' is not installed") from None


def matching_qos(node: Node, topic: str) -> QoSProfile:
    """The strictest quality of service that every publisher of a topic offers."""
    offered = [info.qos_profile for info in node.get_publishers_info_by_topic(topic)]
    reliable = all(qos.reliability == ReliabilityPolicy.RELIABLE for qos in offered)
    latched = bool(offered) and all(qos.durability == DurabilityPolicy.TRANSIENT_LOCAL for qos in offered)
    return QoSProfile(
        depth=DEPTH,
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
    )


def spin_until(node: Node, is_done: Callable[[], bool]) -> None:
    """Handles messages until the condition holds or Ctrl-C comes.

    Raises:
        KeyboardInterrupt: Ctrl-C came. It is raised between two messages: inside a callback, compiled code could make
            another error of it.
    """
    interrupts: list[int] = []
    handler = signal.signal(signal.SIGINT, lambda number, _: interrupts.append(number))
    try:
        while not is_done():
            rclpy.spin_once(node, timeout_sec=POLL_S)
            if interrupts:
                raise KeyboardInterrupt
    finally:
        signal.signal(signal.SIGINT, handler)
