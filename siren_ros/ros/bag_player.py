"""Publishes a recorded episode on its own topics, with the quality of service and the clock of the live run."""

import time
from contextlib import ExitStack
from pathlib import Path
from typing import Any, Final

from rclpy.clock import Clock, ClockType
from rclpy.duration import Duration
from rclpy.node import Node
from std_srvs.srv import SetBool

from siren_ros.interfaces.topics import CLOCK, EVERY_STEP, ONCE, Topic
from siren_ros.recording.bag_reader import BagMessage, open_bag
from siren_ros.recording.playback import NS_PER_S, Playhead, messages_from
from siren_ros.ros.domain import check_alone
from siren_ros.ros.endpoints import create_output
from siren_ros.ros.node_configs import PlayerConfig
from siren_ros.ros.parameters import declare_config
from siren_ros.world.errors import BagError

TICK_S: Final = 0.005
PAUSE_SERVICE: Final = "~/pause"


class BagPlayer(Node):
    """Plays one bag, once or again and again; ``finished`` when it has come to the end."""

    def __init__(self, name: str, **node_options: Any) -> None:
        """Opens the bag and its publishers.

        Raises:
            BagError: The bag cannot be read, or a message type of it is not installed.
            InputError: An episode or another player publishes in this domain already.
        """
        super().__init__(name, **node_options)
        began_s = time.monotonic()
        config = declare_config(self, PlayerConfig)
        self.finished = False
        self._damage: BagError | None = None
        self._loop = config.loop
        self._start_ns = round(config.start_s * NS_PER_S)
        self._open = ExitStack()
        self._bag = self._open.enter_context(open_bag(Path(config.bag)))
        self._outputs = {topic: self._publisher(topic, kind) for topic, kind in self._bag.type_names.items()}
        if CLOCK.name not in self._outputs:
            raise BagError(config.bag, f"an episode with {CLOCK.name}")
        check_alone(self, began_s + config.delay_s / 2.0)
        self._messages = messages_from(self._bag, self._start_ns)
        self._next: BagMessage | None = next(self._messages, None)
        self._playhead = Playhead(self._first_ns(), time.monotonic() + config.delay_s, config.rate, config.paused)
        self.create_service(SetBool, PAUSE_SERVICE, self._on_pause)
        self.create_timer(TICK_S, self._on_tick, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def _publisher(self, name: str, type_name: str) -> Any:
        period = ONCE if name in self._bag.latched else EVERY_STEP
        try:
            return create_output(self, Topic(name, type_name, self.get_name(), period_steps=period))
        except (ImportError, AttributeError, ValueError) as error:
            raise BagError(str(self._bag.path), f"types that are installed, unlike {type_name} of {name}") from error

    def _first_ns(self) -> int:
        """Where the playhead begins: what is latched from before goes out at once."""
        return self._start_ns if self._next is None else max(self._start_ns, self._next.time_ns)

    def _on_pause(self, request: Any, response: Any) -> Any:
        self._playhead = self._playhead.pause(time.monotonic(), bool(request.data))
        response.success = True
        response.message = f"{'paused' if request.data else 'playing'} at {self._playhead.position_ns / NS_PER_S:.2f} s"
        return response

    def _on_tick(self) -> None:
        now_s = time.monotonic()
        if self.finished or now_s < self._playhead.since_s:
            return
        self._playhead = self._playhead.advance(now_s)
        try:
            self._publish_due()
        except BagError as error:
            self._damage, self.finished = error, True

    def _publish_due(self) -> None:
        while self._next is not None and self._next.time_ns <= self._playhead.position_ns:
            if self._playhead.paused:
                return
            self._outputs[self._next.topic].publish(bytes(self._next.cdr))
            self._next = next(self._messages, None)
        if self._next is None and not self._restart():
            self.finished = True

    def _restart(self) -> bool:
        if not self._loop:
            return False
        self._messages = messages_from(self._bag, self._start_ns)
        self._next = next(self._messages, None)
        self._playhead = Playhead(self._first_ns(), time.monotonic(), self._playhead.rate, self._playhead.paused)
        return self._next is not None

    def flush(self, timeout_s: float) -> None:
        """Wait until subscribers have everything, at most for a while in all.

        Raises:
            BagError: It ended early, where the bag is damaged.
        """
        deadline_s = time.monotonic() + timeout_s
        for publisher in self._outputs.values():
            publisher.wait_for_all_acked(Duration(seconds=max(0.0, deadline_s - time.monotonic())))
        if self._damage is not None:
            raise self._damage

    def close_early(self, reason: str) -> None:
        """Nothing to save."""

    def destroy_node(self) -> None:
        """Close the bag with the node."""
        self._open.close()
        super().destroy_node()
