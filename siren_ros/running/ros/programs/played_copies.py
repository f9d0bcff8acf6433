"""Publishes what a viewer of a played bag needs and no bag contains: copies of the steps, and the roster."""

from collections.abc import Callable, Collection, Mapping
from dataclasses import replace
from typing import Any, Final

from rclpy.node import Node

from siren_ros.base.numerics.units import step_of_time_ns
from siren_ros.data.interfaces import wire
from siren_ros.data.interfaces.conversions import from_events, from_traffic_state, to_traffic_state
from siren_ros.data.interfaces.topics import ACTORS, EPISODE_END, EVENTS, ROSTER, TRAFFIC
from siren_ros.data.recording.bag_reader import BagMessage, OpenBag, damage_refused
from siren_ros.running.ros.transport.copies import Copy, step_copies
from siren_ros.running.ros.transport.endpoints import create_output
from siren_ros.simulation.world.actors import ActorDescription
from siren_ros.simulation.world.traffic_state import TrafficState

_READ: Final[Mapping[str, Callable[[Any], Any]]] = {
    TRAFFIC.name: from_traffic_state,
    ACTORS.name: lambda _: None,
    EVENTS.name: from_events,
}
"""Conversion of each topic's messages for ``Copy.take``."""


class PlayedCopies:
    """Publishes the copies while a viewer listens."""

    def __init__(self, node: Node, bag: OpenBag, played: Collection[str]) -> None:
        """Create the publishers for the played topics."""
        self._bag = bag
        self._copies = {topic.name: Copy(node, topic) for topic in (TRAFFIC, ACTORS, EVENTS) if topic.name in played}
        wire.get_ready(ROSTER)
        self._roster_output = create_output(node, ROSTER)
        self._roster: tuple[ActorDescription, ...] | None = None

    def forget(self) -> None:
        """Forget the state, because the player goes to another time."""
        self._roster = None

    def take(self, message: BagMessage) -> None:
        """Process a played message.

        Raises:
            BagError: It cannot be read.
        """
        if message.topic == EPISODE_END.name:
            step_copies.send_held()
        copy = self._copies.get(message.topic)
        if copy is None or not copy.wanted:
            return
        with damage_refused(self._bag.path):
            content = _READ[message.topic](message.read())
            if message.topic == TRAFFIC.name:
                self._introduce(message.time_ns, content)
            copy.take(step_of_time_ns(message.time_ns), content, bytes(message.cdr))

    def _introduce(self, time_ns: int, traffic: TrafficState) -> None:
        """Publish the roster if actors have changed or it was never published."""
        if self._roster is not None and not traffic.spawned:
            return
        if self._roster is None:
            self._roster = self._spawned_before(time_ns)
        self._roster += traffic.spawned
        self._roster_output.publish(wire.encode(ROSTER, to_traffic_state(replace(traffic, spawned=self._roster))))

    def _spawned_before(self, time_ns: int) -> tuple[ActorDescription, ...]:
        spawned: list[ActorDescription] = []
        for message in self._bag.messages({TRAFFIC.name}):
            if message.time_ns >= time_ns:
                break
            spawned += from_traffic_state(message.read()).spawned
        return tuple(spawned)

    def flush(self, timeout_s: float) -> None:
        """Wait until subscribers have everything, up to a time limit for each topic."""
        step_copies.send_held()
        for copy in self._copies.values():
            copy.wait_acknowledged(timeout_s)
