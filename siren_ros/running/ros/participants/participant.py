"""Base class of all nodes in the lockstep."""

import time
import traceback
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, Generic, TypeVar

from rclpy.duration import Duration
from rclpy.node import Node

from siren_ros.data.interfaces import topics, wire
from siren_ros.data.interfaces.conversions import (
    EpisodeClosing,
    Phase,
    StepReport,
    from_episode_description,
    from_episode_end,
    to_step_done,
)
from siren_ros.data.interfaces.topics import Topic
from siren_ros.data.lockstep import Input, TickJoin, once
from siren_ros.errors import EpisodeError, SirenError
from siren_ros.running.ros.node_configs import ParticipantConfig
from siren_ros.running.ros.parameters import declare_config
from siren_ros.running.ros.participants.watchdog import Work, working_s
from siren_ros.running.ros.transport.endpoints import (
    Copy,
    PublisherWatch,
    create_input,
    create_output,
    create_wall_timer,
    step_copies,
)
from siren_ros.simulation.scenario.episode import EpisodeDescription, EpisodeEnd
from siren_ros.simulation.scenario.sealing import opened

Config = TypeVar("Config", bound=ParticipantConfig)
Content = TypeVar("Content")

HOUSEKEEPING_S = 0.02


class Participant(Node, Generic[Config]):
    """A node that acts on a step when all its inputs have arrived, and then reports StepDone.

    Subclasses give their config type and implement ``prepare`` (once, when the episode is known),
    ``on_step`` and, where there is something to close, ``close``. An exception in any of them becomes
    the error of the report, which ends the episode under this node's name.
    """

    config_type: type[Config]
    inputs: tuple[Input, ...] = ()
    outputs: tuple[Topic, ...] = ()
    needs_episode = True

    def __init__(self, name: str, **node_options: Any) -> None:
        super().__init__(name, **node_options)
        self._called = self.get_name()
        self.config = declare_config(self, self.config_type)
        self.finished = False
        self.work: Work | None = None
        self._failed = False
        self._prepared = False
        self._join = TickJoin(self.inputs)
        self._watches: list[PublisherWatch] = []
        self._outputs: dict[str, tuple[Topic, Any]] = {}
        self._copies: dict[str, Copy] = {}
        for topic in self.outputs:
            self.add_output(topic)
        self._report = create_output(self, topics.STEP_DONE)
        for item in self.inputs:
            self.add_input(item.topic, partial(self._on_input, item.topic))
        self._episode: EpisodeDescription | None = None
        self._map_xml: bytes | None = None
        if self.needs_episode:
            self.add_input(topics.EPISODE, self._on_episode)
            self.add_input(topics.MAP, self._on_map)
        create_input(self, topics.EPISODE_END, self._on_end, self._watch(topics.EPISODE_END))
        self._ready_sent = False
        self._until_ready = create_wall_timer(self, HOUSEKEEPING_S, self._housekeeping)

    # Methods that subclasses define.

    def prepare(self, episode: EpisodeDescription, map_xml: bytes) -> None:
        """Prepare for the episode. Nodes that make the episode themselves set ``needs_episode = False``."""

    def on_step(self, step: int, inputs: dict[str, Any]) -> None:
        """Act on a step; ``inputs`` holds the messages by topic name."""

    def close(self, closing: EpisodeClosing) -> None:
        """Close what was opened for the episode."""

    def discard(self) -> None:
        """Undo effects of the constructor outside this process, because another node could not be prepared."""

    def close_early(self, reason: str) -> None:
        """Close without the end message: the program that sends it has ended.

        Raises:
            SirenError: As ``close``.
        """
        if not self.finished:
            self.finished = True
            self.close(EpisodeClosing(self.steps_done, EpisodeEnd.FAILED, reason))

    # Methods that subclasses use.

    @property
    def steps_done(self) -> int:
        """Number of steps on which this node has acted."""
        return self._join.next_step

    def add_output(self, topic: Topic) -> None:
        """Create the publisher of a topic."""
        wire.get_ready(topic)
        self._outputs[topic.name] = (topic, create_output(self, topic))
        if topic.name in topics.OBSERVED:
            self._copies[topic.name] = Copy(self, topic)

    def add_input(self, topic: Topic, callback: Callable[[Any], None]) -> None:
        """Subscribe to a topic; the callback gets the message, and its errors go into this node's report."""
        wire.get_ready(topic)
        self.add_raw_input(topic, lambda cdr: callback(wire.decode(topic, cdr)))

    def add_raw_input(self, topic: Topic, callback: Callable[[bytes], None]) -> None:
        """Subscribe to a topic; the callback gets the serialised message."""
        watch = self._watch(topic)

        def receive(cdr: bytes) -> None:
            try:
                callback(cdr)
            except SirenError as error:
                if watch is not None and (stranger := watch.stranger()):
                    raise EpisodeError(stranger) from error
                raise

        create_input(self, topic, lambda cdr: self._receiving(lambda: receive(cdr)), watch)

    def _watch(self, topic: Topic) -> PublisherWatch | None:
        """Watch for foreign publishers on a decisive topic; the error goes into this node's report."""
        if topic.name not in topics.DECISIVE_TOPICS:
            return None

        def refuse(text: str) -> None:
            raise EpisodeError(text)

        watch = PublisherWatch(self, topic, lambda text: self._receiving(lambda: refuse(text)))
        self._watches.append(watch)
        return watch

    def _receiving(self, action: Callable[[], None]) -> None:
        if self.finished:
            return
        phase = Phase.STEP if self._ready_sent else Phase.READY
        self._guarded(self._join.next_step, phase, action)

    def join_more(self, inputs: Sequence[Input]) -> None:
        """Add topics to the inputs of steps, once the episode is known."""
        added = tuple(inputs)
        self.inputs = (*self.inputs, *added)
        self._join.add(added)
        for item in added:
            self.add_input(item.topic, partial(self._on_input, item.topic))

    def send(self, topic: Topic, message: Any) -> None:
        """Publish on a declared output topic."""
        self._outputs[topic.name][1].publish(wire.encode(topic, message))

    def send_content(self, topic: Topic, step: int, content: Content, write: Callable[[Content], Any]) -> None:
        """Publish the message that ``write`` makes of a step's content; see ``wire.encode_content``."""
        cdr = wire.encode_content(topic, step, content, write)
        self._outputs[topic.name][1].publish(cdr)
        if topic.name in self._copies:
            self._copies[topic.name].take(step, content, cdr)

    def has_listeners(self, topic: Topic) -> bool:
        """Whether an output has subscribers."""
        return bool(self._outputs[topic.name][1].get_subscription_count())

    def is_connected(self) -> bool:
        """Whether every publisher has its required subscribers, and every subscription a publisher."""
        participants = self.config.participants
        reached = all(
            publisher.get_subscription_count() >= topic.subscriber_count(participants)
            for topic, publisher in self._outputs.values()
        )
        heard = all(self.count_publishers(item.topic.name) for item in self.inputs)
        return reached and heard and bool(self._report.get_subscription_count())

    def flush(self, timeout_s: float) -> None:
        """Wait until subscribers have received all messages, up to a time limit.

        A subscriber that hangs or was killed acknowledges nothing.
        """
        deadline_s = time.monotonic() + timeout_s
        for publisher in (self._report, *(publisher for _, publisher in self._outputs.values())):
            publisher.wait_for_all_acked(Duration(seconds=max(0.0, deadline_s - time.monotonic())))
        for copy in self._copies.values():
            copy.wait_acknowledged(max(0.0, deadline_s - time.monotonic()))

    # The protocol of the lockstep.

    def _on_episode(self, message: Any) -> None:
        once(topics.EPISODE, self._episode)
        self._episode = opened(from_episode_description(message))
        self._try_prepare()

    def _on_map(self, message: Any) -> None:
        once(topics.MAP, self._map_xml)
        self._map_xml = message.data.encode()
        self._try_prepare()

    def _try_prepare(self) -> None:
        if self._episode is None or self._map_xml is None or self._prepared:
            return
        self._prepared = True
        self.prepare(self._episode, self._map_xml)

    def _housekeeping(self) -> None:
        if self._ready_sent or self._failed:
            self._until_ready.cancel()
        elif (self._prepared or not self.needs_episode) and self.is_connected():
            self._ready_sent = True
            for watch in self._watches:
                watch.bind()
            if not self._failed:
                self.report(Phase.READY, 0)

    def _on_input(self, topic: Topic, message: Any) -> None:
        if self.finished:
            return
        for step, inputs in self._join.offer(topic.name, wire.step_of_message(topic, message), message):
            began = time.perf_counter()
            self.on_step(step, inputs)
            self.step_finished(step, time.perf_counter() - began)

    def step_finished(self, step: int, busy_s: float) -> None:
        """Report a step; nodes that finish steps later than they act on them override this."""
        self.report(Phase.STEP, step, busy_s=busy_s)

    def report(self, phase: Phase, step: int, *, error: str = "", busy_s: float = 0.0) -> None:
        """Publish StepDone."""
        report = StepReport(step, self._called, phase, error, busy_s)
        self._report.publish(wire.encode_content(topics.STEP_DONE, step, report, to_step_done))

    def announce_compiling(self) -> None:
        """Report that this node is late because it compiles loops. Any thread may call it."""
        report = StepReport(self.steps_done, self._called, Phase.COMPILING)
        self._report.publish(to_step_done(report))

    def _guarded(self, step: int, phase: Phase, action: Callable[[], None]) -> None:
        if self._failed and phase is not Phase.FINAL:
            return
        outer, self.work = self.work, Work(self._called, phase, step, working_s())
        try:
            action()
        except (SirenError, OSError) as error:
            self._fail(phase, step, str(error))
        except Exception as error:  # noqa: BLE001 - any failure must end the episode with this node's name
            self.get_logger().error(traceback.format_exc())
            self._fail(phase, step, f"{type(error).__name__}: {error}")
        finally:
            self.work = outer

    def _fail(self, phase: Phase, step: int, error: str) -> None:
        self._failed = True
        self.report(phase, step, error=error)

    def _on_end(self, cdr: bytes) -> None:
        # A participant that has failed must close, too.
        if not self.finished:
            self._failed = False
            self._guarded(self._join.next_step, Phase.FINAL, lambda: self._end(cdr))

    def _end(self, cdr: bytes) -> None:
        closing = from_episode_end(wire.decode(topics.EPISODE_END, cdr))
        self.finished = True
        step_copies.send_held()
        self.close(closing)
        self.report(Phase.FINAL, max(closing.steps - 1, 0))
