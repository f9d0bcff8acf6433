"""Hands messages from node to node within a process, while all subscribers of a topic are in it.

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
"""Messages that are handed over in a row, about those of one step: then the executor has its turn, with other programs'
messages and with timers."""


class DirectDelivery:
    """The queue of one process."""

    def __init__(self) -> None:
        self._receivers: dict[str, list[Receive]] = {}
        self._waiting: deque[tuple[Receive, bytes]] = deque()
        self._executor: Any = None
        self._under_way = False

    def start(self, executor: Any, nodes: Iterable[Node]) -> None:
        """From now on nodes of an executor get messages directly; they have made all their subscriptions."""
        self._executor, self._under_way = executor, False
        self._waiting.clear()
        self.stop()
        for node in nodes:
            for subscription in node.subscriptions:
                if subscription.raw:
                    self._receivers.setdefault(subscription.topic_name, []).append(subscription.callback)

    def stop(self) -> None:
        """From now on DDS brings all messages; those that wait are still handed over."""
        self._receivers.clear()

    def take(self, topic: str, cdr: bytes, subscribers: Callable[[], int]) -> bool:
        """Take a message over; False where DDS has to bring it.

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
"""Of this process."""
