"""Copies steps of an episode for programs that only watch: enough to show its course, and all events.

Each copy costs the lockstep time. An episode that runs as fast as it can makes hundreds of steps in a second, more than
anybody can look at. So copied steps are ``PERIOD_S`` of wall time apart, but each step is copied in which something
happens, and the last one. At real time and slower, all are. What the nodes and the bag get does not depend on it.
"""

import time
from collections.abc import Callable
from typing import Any, Final

from rclpy.duration import Duration
from rclpy.node import Node

from siren_ros.base.numerics.units import STEP_S
from siren_ros.data.interfaces.topics import EVENTS, OBSERVED, TRAFFIC, Topic
from siren_ros.running.ros.transport.endpoints import message_class, qos_of

PERIOD_S: Final = STEP_S
"""Least wall time between copied steps. An episode at real time then has all its steps copied. A viewer shows twenty
steps per second as smooth motion, and needs no more (``live_server.BATCH_S``)."""
EARLY_PERIODS: Final = 3
"""Tolerance in periods: after a halt the master begins two steps at once, and step times vary."""


class StepCopies:
    """Chooses the steps that a process copies: all topics of a step, or none."""

    def __init__(self, period_s: float = PERIOD_S, clock_s: Callable[[], float] = time.monotonic) -> None:
        """Start before the first step; ``clock_s`` gives wall time from an arbitrary origin."""
        self._period_s, self._clock_s = period_s, clock_s
        self._step, self._chosen, self._due_s = -1, False, -float("inf")
        self._held: list[Callable[[], None]] = []

    def take(self, step: int, happens: bool, publish: Callable[[], None]) -> None:
        """Publish the copy of a step's message, or hold it until the next step begins.

        Args:
            step: Its step, as of the call before or a later one.
            happens: Whether it says what no later message says again; then the whole step is copied.
            publish: Sends the copy.
        """
        if step != self._step:
            self._step, self._chosen = step, self._is_due()
            self._held.clear()
        self._held.append(publish)
        if self._chosen or happens:
            self.send_held()

    def send_held(self) -> None:
        """Publish the copy of the latest step, for example because it is the last one."""
        self._chosen = True
        for publish in self._held:
            publish()
        self._held.clear()

    def _is_due(self) -> bool:
        now_s = self._clock_s()
        if now_s < self._due_s - EARLY_PERIODS * self._period_s:
            return False
        self._due_s = max(self._due_s, now_s) + self._period_s
        return True


step_copies: Final = StepCopies()
"""The chooser of this process."""


def happens(topic: str, content: Any, before: Any) -> bool:
    """Whether a message contains an event, which no later message repeats.

    Args:
        topic: A topic of ``OBSERVED``.
        content: What the message was made from: a ``TrafficState``, or a step with its hash and events.
        before: Time of the topic's message before; None for the first one.
    """
    if topic == EVENTS.name:
        return len(content[2]) > 0
    return topic == TRAFFIC.name and (before is None or bool(content.spawned) or content.signals != before.signals)


class Copy:
    """Publisher of the copies of one topic."""

    def __init__(self, node: Node, topic: Topic) -> None:
        """Create the publisher; ``topic`` is one of those in ``OBSERVED``."""
        copy = OBSERVED[topic.name]
        self._publisher: Any = node.create_publisher(message_class(copy.type_name), copy.name, qos_of(copy))
        self._topic, self._before = topic.name, None

    @property
    def wanted(self) -> bool:
        """Whether the copies have a subscriber."""
        return bool(self._publisher.get_subscription_count())

    def take(self, step: int, content: Any, cdr: bytes) -> None:
        """Process a published message, with its content (as of ``happens``)."""
        if self.wanted:
            before, self._before = self._before, content
            step_copies.take(step, happens(self._topic, content, before), lambda: self._publisher.publish(cdr))

    def wait_acknowledged(self, timeout_s: float) -> bool:
        """Whether all subscribers have everything, now or within a time."""
        return bool(self._publisher.wait_for_all_acked(Duration(seconds=timeout_s)))
