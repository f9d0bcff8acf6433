"""Notices publishers on a topic that a run does not know.

What a subscription receives does not say who sent it (rclpy passes no identity of the publisher on). But DDS matches a
publisher with a subscription before the first message of it arrives, and tells how many have matched so far. So a topic
on which a run decides has exactly the publishers that the run knows, or the run ends.
"""

import time
from collections.abc import Callable, Collection
from typing import Any, Final

from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node

from siren_ros.interfaces.topics import STEERED_FROM_OUTSIDE, Topic

_NAME_PATIENCE_S: Final = 0.3
"""Discovery learns of a publisher a little before it learns the name of its node."""
_POLL_S: Final = 0.01
_UNNAMED: Final = "_NODE_NAME_UNKNOWN_"
"""What the middleware says where it has not learned the name."""


class PublisherWatch:
    """Counts the publishers that a subscription has met.

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
        """Watches nothing yet: ``callbacks`` go to the subscription.

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
        """For the subscription to the topic."""
        return SubscriptionEventCallbacks(matched=self._on_matched)

    def bind(self) -> None:
        """From now on nobody may come beyond those that the run knows; some of these may not have been met yet."""
        if not self._bound:
            self._bound = True
            self._limit = self._total + max(0, self._known - self._current)
            if self._current > self._known:
                self._tell(self._current - self._known)
            self._names |= self._node_names()

    def departed(self) -> frozenset[str]:
        """Nodes that published when the watch was bound, and do not any more."""
        return self._names - self._node_names()

    def _node_names(self) -> frozenset[str]:
        return frozenset(info.node_name for info in self._node.get_publishers_info_by_topic(self._topic.name))

    def _on_matched(self, status: Any) -> None:
        left = status.current_count < self._current
        self._total, self._current = status.total_count, status.current_count
        if self._bound and self._total > self._limit:
            self._tell(self._total - self._limit)
        elif left:
            self.on_left()

    def stranger(self) -> str:
        """What is wrong if more publish now than the run knows, else an empty text.

        The executor may hand a message over before it tells of the publisher.
        """
        known = self._known if self._bound else max(self._known, self._current)
        present = self._node.get_publishers_info_by_topic(self._topic.name)
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
        """What is known of the nodes that are too many; discovery gets a moment to learn their names."""
        until_s = time.monotonic() + _NAME_PATIENCE_S
        while True:
            nodes = [info.node_name for info in self._node.get_publishers_info_by_topic(self._topic.name)]
            names = {*nodes} - self._names - {_UNNAMED}
            if names or len(nodes) <= self._known or time.monotonic() >= until_s:
                break
            time.sleep(_POLL_S)
        names = names or ({*nodes} - {_UNNAMED} if len(nodes) > self._known else set())
        return ", ".join(f"node {name}" for name in sorted(names)) or "it has left again"
