"""Publishers and subscriptions of the table's topics, with their quality of service."""

from collections.abc import Callable
from functools import cache
from importlib import import_module
from typing import Any, Final

from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

from siren_ros.interfaces.topics import STEP_DONE, Topic
from siren_ros.ros.transport.publisher_watch import PublisherWatch

STREAM_DEPTH: Final = 8
"""The lockstep keeps at most two steps in flight, so a participant can never miss one. A passive
subscriber that falls behind loses its own oldest messages and slows nobody."""
REPORT_DEPTH: Final = 64
"""Of StepDone: every participant may report at once."""


@cache
def message_class(type_name: str) -> Any:
    """The Python class of a type such as ``siren_msgs/msg/Event``."""
    package, _, name = type_name.split("/")
    return getattr(import_module(f"{package}.msg"), name)


def qos_of(topic: Topic) -> QoSProfile:
    """Everything is reliable; what is said once is kept for late subscribers."""
    depth = REPORT_DEPTH if topic == STEP_DONE else STREAM_DEPTH
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST,
        depth=1 if topic.latched else depth,
        reliability=ReliabilityPolicy.RELIABLE,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if topic.latched else DurabilityPolicy.VOLATILE,
    )


def create_output(node: Node, topic: Topic) -> Any:
    """The publisher of a topic; it takes encoded messages."""
    return node.create_publisher(message_class(topic.type_name), topic.name, qos_of(topic))


def create_input(
    node: Node, topic: Topic, callback: Callable[[bytes], None], watch: PublisherWatch | None = None
) -> Any:
    """A subscription to a topic; the callback gets the encoded message, and the watch learns of the publishers."""
    callbacks = None if watch is None else watch.callbacks
    kind, quality = message_class(topic.type_name), qos_of(topic)
    return node.create_subscription(kind, topic.name, callback, quality, raw=True, event_callbacks=callbacks)
