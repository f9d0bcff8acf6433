"""Passes messages directly between nodes of a process while all subscribers of a topic are in it.

DDS copies a message for each of its subscribers, and wakes the executor for each copy; both cost more than what most
nodes do with it. So a message that only nodes of this process get goes through a queue, as the bytes that it is. From
the moment in which DDS has met one more listener, for example a recorder or RViz, it brings the topic to everybody.
"""

from collections import deque
from collections.abc import Callable, Iterable
from typing import Any, Final

from rclpy.node import Node

Receive = Callable[[bytes], None]

AT_ONCE: Final = 32
"""Number of messages passed in a row, about those of one step. Then the executor handles other programs' messages and
timers."""


class DirectDelivery:
    """Message queue of one process."""

    def __init__(self) -> None:
        self._receivers: dict[str, list[Receive]] = {}
        self._waiting: deque[tuple[Receive, bytes]] = deque()
        self._executor: Any = None
        self._under_way = False

    def start(self, executor: Any, nodes: Iterable[Node]) -> None:
        """Start direct delivery to an executor's nodes, which have made all their subscriptions."""
        self._executor, self._under_way = executor, False
        self._waiting.clear()
        self.stop()
        for node in nodes:
            for subscription in node.subscriptions:
                if subscription.raw:
                    self._receivers.setdefault(subscription.topic_name, []).append(subscription.callback)

    def stop(self) -> None:
        """Stop direct delivery; DDS brings all further messages, and waiting ones are still delivered."""
        self._receivers.clear()

    def take(self, topic: str, cdr: bytes, subscribers: Callable[[], int]) -> bool:
        """Accept a message for direct delivery; False if DDS must bring it.

        Args:
            topic: Name of the topic.
            cdr: The message.
            subscribers: How many subscriptions of all programs the publisher knows now; takes 1 µs.
        """
        receivers = self._receivers.get(topic)
        if receivers is None or subscribers() != len(receivers):
            return False
        self._waiting.extend([(receive, cdr) for receive in receivers])
        self._go_on()
        return True

    def _go_on(self) -> None:
        if not self._under_way:
            self._under_way = True
            self._executor.create_task(self._hand_over)

    def _hand_over(self) -> None:
        try:
            for _ in range(AT_ONCE):
                if not self._waiting:
                    break
                receive, cdr = self._waiting.popleft()
                receive(cdr)
        finally:
            self._under_way = False
            if self._waiting:
                self._go_on()


direct: Final = DirectDelivery()
"""The queue of this process."""
