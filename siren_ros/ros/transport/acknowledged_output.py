"""A publisher whose next message goes out when every subscriber has the last one."""

from typing import Any, Final

from rclpy.duration import Duration
from rclpy.node import Node

from siren_ros.interfaces.topics import Topic
from siren_ros.ros.transport.endpoints import message_class, qos_of

PATIENCE_S: Final = 10.0
"""A subscriber without an answer for this time hangs or is dead. Fast DDS sends lost data again after at most 3 s, and
after a second loss 3 s later."""


class AcknowledgedOutput:
    """A publisher that loses no message on the way to a subscriber, also a large one that is sent in many fragments.

    Fast DDS keeps the last messages of a topic. A new message replaces the oldest, even one that has not arrived. Fast
    DDS asks for acknowledgements when its history is full, and otherwise every 3 s. So this publisher has a history of
    one message: its acknowledgement comes after 6 ms, and missing fragments are sent again at once. The depth of a
    publisher's history does not affect which subscribers match it.
    """

    def __init__(self, node: Node, topic: Topic) -> None:
        """Create the publisher; ImportError, AttributeError or ValueError where the type is not installed."""
        self.topic = topic
        quality = qos_of(topic)
        quality.depth = 1
        self._publisher: Any = node.create_publisher(message_class(topic.type_name), topic.name, quality)
        self._waits_since_s: float | None = None
        self.deaf = False
        """Whether a subscriber has not answered in time; it is not waited for until all have answered again."""

    def is_ready(self, now_s: float) -> bool:
        """Whether every subscriber has the last message, or does not answer any more; does not wait."""
        if self.wait_acknowledged(0.0):
            self._waits_since_s, self.deaf = None, False
            return True
        if self._waits_since_s is None:
            self._waits_since_s = now_s
        self.deaf = self.deaf or now_s - self._waits_since_s > PATIENCE_S
        return self.deaf

    def publish(self, cdr: bytes) -> None:
        """Publish an encoded message."""
        self._publisher.publish(cdr)

    def wait_acknowledged(self, timeout_s: float) -> bool:
        """Whether every subscriber has everything, now or within a time."""
        return bool(self._publisher.wait_for_all_acked(Duration(seconds=timeout_s)))
