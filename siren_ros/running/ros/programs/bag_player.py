"""Publishes a recorded episode on its own topics, with the same quality of service and clock as the live run.

It has the services of rosbag2's player, with its names and types. A viewer also gets what no bag contains: copies of
the steps, and the roster.
"""

import math
import time
from collections.abc import Callable, Collection, Mapping
from contextlib import ExitStack
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, Final

from rclpy.node import Node
from rosbag2_interfaces.srv import Burst, GetRate, IsPaused, Pause, PlayNext, Resume, Seek, SetRate, TogglePaused

from siren_ros.base.numerics.units import step_of_time_ns
from siren_ros.data.interfaces import wire
from siren_ros.data.interfaces.conversions import from_events, from_traffic_state, to_traffic_state
from siren_ros.data.interfaces.topics import (
    ACTORS,
    CLOCK,
    EPISODE_END,
    EVENTS,
    EVERY_STEP,
    ONCE,
    ROSTER,
    TRAFFIC,
    Topic,
)
from siren_ros.data.recording.bag_reader import (
    NS_PER_S,
    BagMessage,
    OpenBag,
    Playhead,
    damage_refused,
    messages_from,
    open_bag,
)
from siren_ros.errors import BagError, InputError
from siren_ros.running.ros.node_configs import PlayerConfig
from siren_ros.running.ros.parameters import declare_config
from siren_ros.running.ros.transport.dds import check_alone, claimed_domain
from siren_ros.running.ros.transport.endpoints import (
    PATIENCE_S,
    AcknowledgedOutput,
    Copy,
    create_output,
    create_wall_timer,
    step_copies,
)
from siren_ros.simulation.world.actors import ActorDescription, TrafficState

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


PREFIX: Final = "/rosbag2_player"
"""Name of rosbag2's node; programs that control a player call its services."""


def offer_services(node: Node, player: "BagPlayer") -> None:
    """Create the player's services on a node."""
    # For each service: its type, and the function that makes the response from a request.
    services: dict[str, tuple[Any, Callable[[Any], Mapping[str, object]]]] = {
        "pause": (Pause, lambda _: player.pause(True)),
        "resume": (Resume, lambda _: player.pause(False)),
        "toggle_paused": (TogglePaused, lambda _: player.pause(not player.paused)),
        "is_paused": (IsPaused, lambda _: {"paused": player.paused}),
        "get_rate": (GetRate, lambda _: {"rate": player.rate}),
        "set_rate": (SetRate, lambda request: {"success": player.set_rate(request.rate)}),
        "seek": (Seek, lambda request: {"success": player.seek(request.time.sec * NS_PER_S + request.time.nanosec)}),
        "play_next": (PlayNext, lambda _: {"success": player.play_next(1) == 1}),
        "burst": (Burst, lambda request: {"actually_burst": player.play_next(request.num_messages)}),
    }

    def answered(name: str, request: Any, _response: Any) -> Any:
        kind, fields_of = services[name]
        return kind.Response(**fields_of(request))

    for name, (kind, _) in services.items():
        node.create_service(kind, f"{PREFIX}/{name}", partial(answered, name))


TICK_S: Final = 0.004
LARGE_BYTES: Final = 64_000
"""Fast DDS sends larger messages in fragments, so they are sent alone: fragments overwrite unread data in the sender's
shared memory (0.5 MB by default), and lost data is sent again only after 3 s."""


class BagPlayer(Node):
    """Plays one bag, once or repeatedly.

    Services with the names and types of rosbag2's player control it; ``finished`` at the end of the bag.
    """

    config_type = PlayerConfig

    def __init__(self, name: str, **node_options: Any) -> None:
        """Open the bag and create its publishers.

        Raises:
            BagError: The bag cannot be read, or a message type of it is not installed.
            InputError: An episode or another player publishes in this domain already; or a topic that the bag lacks.
        """
        super().__init__(name, **node_options)
        began_s = time.monotonic()
        self.config = declare_config(self, self.config_type)
        self.finished = False
        self._damage: BagError | None = None
        self._large_under_way = False
        self._start_ns = round(self.config.start_s * NS_PER_S)
        self._open = ExitStack()
        self._bag = self._open.enter_context(open_bag(Path(self.config.bag)))
        self._open.enter_context(claimed_domain())
        if CLOCK.name not in self._bag.type_names:
            raise BagError(self.config.bag, f"an episode with {CLOCK.name}")
        self._outputs = {topic: self._output(topic, self._bag.type_names[topic]) for topic in self._chosen_topics()}
        self._copies = PlayedCopies(self, self._bag, self._outputs)
        check_alone(self, began_s)
        self._go_to(self._start_ns)
        begin_s = time.monotonic() + self.config.delay_s
        self._playhead = Playhead(self._first_ns(), begin_s, self.config.rate, self.config.paused)
        offer_services(self, self)
        create_wall_timer(self, TICK_S, self._on_tick)

    def _chosen_topics(self) -> tuple[str, ...]:
        """Topics to play: the clock and those that the user names; by default all."""
        known = tuple(self._bag.type_names)
        chosen = [name if name.startswith("/") else f"/{name}" for name in self.config.topics]
        for name in chosen:
            if name not in known:
                raise InputError("topics", name, "topics of the bag: " + ", ".join(sorted(known)))
        return tuple(name for name in known if not chosen or name in chosen or name == CLOCK.name)

    def _output(self, name: str, type_name: str) -> AcknowledgedOutput:
        period = ONCE if name in self._bag.latched else EVERY_STEP
        try:
            return AcknowledgedOutput(self, Topic(name, type_name, self.get_name(), period_steps=period))
        except (ImportError, AttributeError, ValueError) as error:
            raise BagError(str(self._bag.path), f"types that are installed, unlike {type_name} of {name}") from error

    def _first_ns(self) -> int:
        """Time at which the playhead begins; earlier latched messages are published at once."""
        return self._start_ns if self._next is None else max(self._start_ns, self._next.time_ns)

    def _go_to(self, time_ns: int) -> None:
        """Continue to read from a time, with the messages that are latched then."""
        self._copies.forget()
        end_ns = self._start_ns + round(self.config.playback_duration_s * NS_PER_S)
        self._messages = (
            message
            for message in messages_from(self._bag, time_ns)
            if message.topic in self._outputs and (not self.config.playback_duration_s or message.time_ns < end_ns)
        )
        self._next: BagMessage | None = next(self._messages, None)

    @property
    def paused(self) -> bool:
        """Whether simulated time is paused."""
        return self._playhead.paused

    def pause(self, paused: bool) -> Mapping[str, object]:
        """Pause or resume simulated time; the response of these services is empty."""
        self._playhead = self._playhead.pause(time.monotonic(), paused)
        return {}

    @property
    def rate(self) -> float:
        """Simulated seconds per wall second."""
        return self._playhead.rate

    def set_rate(self, rate: float) -> bool:
        """Change the playback rate; False if it is not positive and finite."""
        if 0.0 < rate < math.inf:
            self._playhead = replace(self._playhead.advance(time.monotonic()), rate=rate)
        return 0.0 < rate < math.inf

    def seek(self, time_ns: int) -> bool:
        """Go to a time of the bag; False if the bag does not cover it."""
        first_ns, last_ns = self._bag.span_ns
        if not first_ns <= time_ns <= last_ns:
            return False
        self._go_to(time_ns)
        self._playhead = replace(self._playhead, position_ns=time_ns, since_s=time.monotonic())
        return True

    def play_next(self, count: int) -> int:
        """Publish the next messages while paused; returns their number. A count of 0 means the rest of the bag.

        It waits for subscribers before each message, as playing does.
        """
        published = 0
        while self.paused and self._next is not None and (not count or published < count):
            if self._may_publish(self._next, time.monotonic()):
                self._playhead = replace(
                    self._playhead, position_ns=max(self._playhead.position_ns, self._next.time_ns)
                )
                self._publish_next()
                published += 1
            else:
                time.sleep(TICK_S)
        return published

    def _on_tick(self) -> None:
        now_s = time.monotonic()
        if self.finished or now_s < self._playhead.since_s:
            return
        self._playhead = self._playhead.advance(now_s)
        try:
            self._publish_due(now_s)
        except BagError as error:
            self._damage, self.finished = error, True

    def _publish_due(self, now_s: float) -> None:
        while self._next is not None and self._next.time_ns <= self._playhead.position_ns:
            if self._playhead.paused:
                return
            if not self._may_publish(self._next, now_s):
                self._playhead = self._playhead.held_at(self._next.time_ns)
                return
            self._publish_next()
        if self._next is None and not self._playhead.paused and not self._restart():
            self.finished = True

    def _publish_next(self) -> None:
        if self._next is not None:
            self._outputs[self._next.topic].publish(bytes(self._next.cdr))
            self._copies.take(self._next)
            self._large_under_way = len(self._next.cdr) > LARGE_BYTES
            self._next = next(self._messages, None)

    def _may_publish(self, message: BagMessage, now_s: float) -> bool:
        """Whether every subscriber has received what it needs before this message."""
        alone = self._large_under_way or len(message.cdr) > LARGE_BYTES
        outputs = self._outputs.values() if alone else (self._outputs[message.topic],)
        knew = [output.deaf for output in outputs]
        ready = [output.is_ready(now_s) for output in outputs]
        for output, was_deaf in zip(outputs, knew, strict=True):
            if output.deaf and not was_deaf:
                self.get_logger().warning(f"{output.topic.name}: a subscriber does not answer; going on without it")
        return all(ready)

    def _restart(self) -> bool:
        if not self.config.loop:
            return False
        self._go_to(self._start_ns)
        self._playhead = Playhead(self._first_ns(), time.monotonic(), self._playhead.rate, self._playhead.paused)
        return self._next is not None

    def flush(self, timeout_s: float) -> None:
        """Wait until subscribers have everything, because a destroyed publisher loses unsent messages.

        Raises:
            BagError: It ended early, where the bag is damaged.
        """
        self._copies.flush(timeout_s)
        deadline_s = time.monotonic() + max(timeout_s, PATIENCE_S)
        for output in self._outputs.values():
            output.wait_acknowledged(0.0 if output.deaf else max(0.0, deadline_s - time.monotonic()))
        if self._damage is not None:
            raise self._damage

    def close_early(self, reason: str) -> None:
        """Do nothing, because there is nothing to save."""

    def destroy_node(self) -> None:
        """Close the bag together with the node."""
        self._open.close()
        super().destroy_node()
