"""A publisher whose next message goes out when every subscriber has the last one."""

from typing import Any, Final

from rclpy.duration import Duration
from rclpy.node import Node

from siren_ros.interfaces.topics import Topic
from siren_ros.ros.transport.endpoints import message_class, qos_of

PATIENCE_S: Final = 10.0
"""A subscriber that has not answered for so long hangs or is dead: Fast DDS repeats what was lost after 3 s at the
latest, and a second loss costs 3 s more."""


class AcknowledgedOutput:
    """Loses nothing, also towards a subscriber that has just come or to which large messages go in many fragments.

    Fast DDS keeps the last messages of a topic and forgets the oldest one for the sake of a new one, whether it has
    arrived or not. It asks its subscribers what they have when it has no room for more, otherwise every 3 s. So this
    publisher keeps one message: the answer to each comes after 6 ms, and what is missing is sent again at once.
    How much a publisher keeps is its own affair, which no subscriber sees.
    """

    def __init__(self, node: Node, topic: Topic) -> None:
        """Create the publisher; ImportError, AttributeError or ValueError where the type is not installed."""
        self.topic = topic
        quality = qos_of(topic)
        quality.depth = 1
        self._publisher: Any = node.create_publisher(message_class(topic.type_name), topic.name, quality)
        self._waits_since_s: float | None = None
        self.deaf = False
        """Whether somebody has not answered in time; he is not waited for until everybody has answered again."""

    def is_ready(self, now_s: float) -> bool:
        """Whether one more message takes nothing from anybody; asks without waiting."""
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
