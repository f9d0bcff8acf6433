"""Publishers and subscriptions of the topics with their quality of service, and timers by wall time.

A watch notices publishers on a topic that a run does not know. What a subscription receives does not say who sent it
(rclpy passes no identity of the publisher on). But DDS matches a publisher with a subscription before the first message
of it arrives, and tells how many have matched so far. So a topic on which a run decides has exactly the publishers that
the run knows, or the run ends.

Direct delivery: DDS copies a message for each of its subscribers, and wakes the executor for each copy; both cost more
than what most nodes do with it. So a message that only nodes of this process get goes through a queue, as the bytes
that it is. From the moment in which DDS has met one more listener, for example a recorder or RViz, it brings the topic
to everybody.

Copies: programs that only watch get copies of steps, enough to show the episode's course, and all events. Each copy
costs the lockstep time. An episode that runs as fast as it can makes hundreds of steps in a second, more than anybody
can look at. So copied steps are ``PERIOD_S`` of wall time apart, but each step is copied in which something happens,
and the last one. At real time and slower, all are. What the nodes and the bag get does not depend on it.
"""

import time
from collections import deque
from collections.abc import Callable, Collection, Iterable
from functools import cache
from importlib import import_module
from typing import Any, Final

from rclpy.clock import Clock, ClockType
from rclpy.duration import Duration
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

from siren_ros.base.numerics.units import STEP_S
from siren_ros.data.interfaces.topics import EVENTS, OBSERVED, STEERED_FROM_OUTSIDE, STEP_DONE, TRAFFIC, Topic

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


_NAME_PATIENCE_S: Final = 2.0
"""Time to wait for a node's name, because discovery finds a publisher before the name of its node."""
_POLL_S: Final = 0.01
_UNNAMED: Final = "_NODE_NAME_UNKNOWN_"
"""The middleware's name for a node whose name is unknown."""


class PublisherWatch:
    """Counts the publishers that a subscription has matched.

    Publishers of other programs may come and go until ``bind``: a user may start a stack twice. From then on, and on
    the topics of the platform's own nodes from the start, one more than the run knows is a stranger, even if it has
    left again.
    """

    def __init__(
        self,
        node: Node,
        topic: Topic,
        on_stranger: Callable[[str], None],
        nodes: Collection[str] | None = None,
        others: int | None = None,
    ) -> None:
        """Prepare the watch; it starts when ``callbacks`` are given to the subscription.

        Args:
            node: Whose view of the graph names the publishers.
            topic: The topic of the subscription.
            on_stranger: Gets the text of the error, once.
            nodes: The platform's own nodes that publish on the topic, one publisher each; by default as in the table.
            others: How many publishers of other programs the run expects; by default as in the table.
        """
        external = topic.name in STEERED_FROM_OUTSIDE
        self._node = node
        self._topic = topic
        self._on_stranger = on_stranger
        self._names = frozenset(() if external else (topic.publisher,)) if nodes is None else frozenset(nodes)
        self._known = len(self._names) + (int(external) if others is None else others)
        self._limit = self._known
        self._bound = self._known == len(self._names)
        self._total = self._current = 0
        self._told = False
        self.on_left: Callable[[], None] = lambda: None
        """Called when a publisher is gone."""

    @property
    def callbacks(self) -> SubscriptionEventCallbacks:
        """Callbacks for the subscription to the topic."""
        return SubscriptionEventCallbacks(matched=self._on_matched)

    def bind(self) -> None:
        """Refuse further publishers from now on, except expected ones that were not matched yet."""
        if not self._bound:
            self._bound = True
            self._limit = self._total + max(0, self._known - self._current)
            if self._current > self._known:
                self._tell(self._current - self._known)
            self._names |= frozenset(self._publishers_when(lambda nodes: _UNNAMED not in nodes))

    def present(self) -> frozenset[str]:
        """Nodes that publish at present."""
        return frozenset(self._publishers())

    def departed(self) -> frozenset[str]:
        """Nodes that published when the watch was bound, and do not any more."""
        return self._names - self.present()

    def _publishers(self) -> list[str]:
        return [info.node_name for info in self._node.get_publishers_info_by_topic(self._topic.name)]

    def _publishers_when(self, is_enough: Callable[[list[str]], bool]) -> list[str]:
        """Nodes of the publishers; waits a moment for discovery of names until they are enough."""
        until_s = time.monotonic() + _NAME_PATIENCE_S
        while not is_enough(nodes := self._publishers()) and time.monotonic() < until_s:
            time.sleep(_POLL_S)
        return nodes

    def _on_matched(self, status: Any) -> None:
        left = status.current_count < self._current
        self._total, self._current = status.total_count, status.current_count
        if self._bound and self._total > self._limit:
            self._tell(self._total - self._limit)
        elif left:
            self.on_left()

    def stranger(self) -> str:
        """Error text if more publishers exist than the run knows, otherwise empty.

        The executor may hand a message over before it tells of the publisher.
        """
        known = self._known if self._bound else max(self._known, self._current)
        present = self._publishers()
        return self._text(len(present) - known) if len(present) > known else ""

    def _tell(self, strangers: int) -> None:
        if not self._told:
            self._told = True
            self._on_stranger(self._text(strangers))

    def _text(self, strangers: int) -> str:
        several = "s" if strangers > 1 else ""
        return (
            f"{self._topic.name}: {strangers} publisher{several} that this episode does not know "
            f"({self._strangers()}); each episode needs a ROS_DOMAIN_ID of its own"
        )

    def _strangers(self) -> str:
        """What is known about the surplus publishers' nodes."""
        known = {*self._names, _UNNAMED}
        nodes = self._publishers_when(lambda nodes: len(nodes) <= self._known or not known.issuperset(nodes))
        names = {*nodes} - known or ({*nodes} - {_UNNAMED} if len(nodes) > self._known else set())
        return ", ".join(f"node {name}" for name in sorted(names)) or "it has left again"


STREAM_DEPTH: Final = 8
"""History depth of topics. The lockstep has at most two steps in flight, so that participants miss nothing; a slow
passive subscriber loses its own oldest messages and slows nobody."""
REPORT_DEPTH: Final = 64
"""History depth of StepDone, since all participants may report at once, and of copies for watching programs."""


@cache
def message_class(type_name: str) -> Any:
    """Python class of a type such as ``siren_msgs/msg/Event``."""
    package, _, name = type_name.split("/")
    return getattr(import_module(f"{package}.msg"), name)


def qos_of(topic: Topic) -> QoSProfile:
    """Quality of service of a topic: all are reliable; single messages are kept for late subscribers."""
    many = topic == STEP_DONE or topic in OBSERVED.values()
    depth = REPORT_DEPTH if many else STREAM_DEPTH
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST,
        depth=1 if topic.latched else depth,
        reliability=ReliabilityPolicy.RELIABLE,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if topic.latched else DurabilityPolicy.VOLATILE,
    )


class Output:
    """Publisher of a topic for encoded messages."""

    def __init__(self, node: Node, topic: Topic) -> None:
        """Create the publisher."""
        self._publisher: Any = node.create_publisher(message_class(topic.type_name), topic.name, qos_of(topic))
        self._name = "" if topic.latched else topic.name
        self.get_subscription_count: Callable[[], int] = self._publisher.get_subscription_count
        self.wait_for_all_acked: Callable[[Duration], bool] = self._publisher.wait_for_all_acked

    def publish(self, cdr: bytes) -> None:
        """Publish an encoded message."""
        if not direct.take(self._name, cdr, self.get_subscription_count):
            self._publisher.publish(cdr)


def create_output(node: Node, topic: Topic) -> Output:
    """Create the publisher of a topic."""
    return Output(node, topic)


def create_input(
    node: Node, topic: Topic, callback: Callable[[bytes], None], watch: PublisherWatch | None = None, depth: int = 0
) -> Any:
    """Create a subscription to a topic; the callback gets the encoded message, the watch is told about publishers.

    A depth is the number of messages that may wait, in place of the table's.
    """
    callbacks = None if watch is None else watch.callbacks
    kind, quality = message_class(topic.type_name), qos_of(topic)
    quality.depth = depth or quality.depth
    return node.create_subscription(kind, topic.name, callback, quality, raw=True, event_callbacks=callbacks)


PATIENCE_S: Final = 10.0
"""A subscriber that is silent for this time hangs or is dead. Fast DDS sends lost data again after at most 3 s, and
after a second loss 3 s later."""


class AcknowledgedOutput:
    """A publisher that loses no message to its subscribers, not even a large one in many fragments.

    Fast DDS keeps the last messages of a topic. A new message replaces the oldest, even one that has not arrived. Fast
    DDS asks for acknowledgements when its history is full, and otherwise every 3 s. So this publisher has a history of
    one message: its acknowledgement comes after 6 ms, and missing fragments are sent again at once. The depth of a
    publisher's history does not affect which subscribers match it.
    """

    def __init__(self, node: Node, topic: Topic) -> None:
        """Create the publisher; ImportError, AttributeError or ValueError if the type is not installed."""
        self.topic = topic
        quality = qos_of(topic)
        quality.depth = 1
        self._publisher: Any = node.create_publisher(message_class(topic.type_name), topic.name, quality)
        self._waits_since_s: float | None = None
        self.deaf = False
        """Whether a subscriber has not answered in time; it is not waited for until all have answered again."""

    def is_ready(self, now_s: float) -> bool:
        """Whether every subscriber has the last message or no longer answers; does not wait."""
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
        """Whether all subscribers have everything, now or within a time."""
        return bool(self._publisher.wait_for_all_acked(Duration(seconds=timeout_s)))


def create_wall_timer(node: Node, period_s: float, callback: Callable[[], None]) -> Any:
    """A node's timer that follows the steady clock, not ``/clock``."""
    return node.create_timer(period_s, callback, clock=Clock(clock_type=ClockType.STEADY_TIME))


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
