"""Records one episode: takes messages in any order, writes each step's messages in a fixed order, then the outcome."""

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, Final, TypeAlias

from rosbags.typesys.store import Typestore

from siren_ros.base.numerics.units import time_ns_of_step
from siren_ros.data.interfaces.conversions import EpisodeClosing, to_episode_end, to_episode_outcome
from siren_ros.data.interfaces.messages import decode_cdr, encode_cdr, step_of_cdr
from siren_ros.data.interfaces.topics import EPISODE_END, OUTCOME, STEERED_FROM_OUTSIDE, Topic
from siren_ros.data.lockstep import MAX_STEPS_AHEAD
from siren_ros.data.recording.bag_writer import BagOptions, BagSummary, EpisodeBagWriter
from siren_ros.data.recording.episode_record import RECORD_TOPICS, Reading, RecordBuilder, read_anew
from siren_ros.errors import EpisodeError, SirenError
from siren_ros.simulation.scenario.episode import EpisodeEnd, EpisodeOutcome

MAX_EARLY_MESSAGES: Final = 1000
"""Limit of messages kept before the episode's topics are known; each latched topic sends one."""
_DECODED = frozenset(topic.name for topic in RECORD_TOPICS)


CollectedMessage: TypeAlias = tuple[Topic, int, bytes]
"""Topic, step and CDR of a message that is ready to be recorded."""


class StepCollector:
    """Sorts the messages of an episode: latched topics first, then step by step, topics in a fixed order.

    The collector does not wait for the outcome; the recorder writes it after all other messages.
    """

    def __init__(self, topics: Sequence[Topic]) -> None:
        """Take the recorded topics of an episode, in the order in which a step's messages are stored."""
        self._topics = {topic.name: topic for topic in topics if topic.name != OUTCOME.name}
        self._latched = [topic for topic in self._topics.values() if topic.latched]
        self._periodic = [topic for topic in self._topics.values() if not topic.latched]
        self._cycle_steps = math.lcm(*(topic.period_steps for topic in self._periodic))
        self._due_at: dict[int, list[Topic]] = {}
        self._held_latched: dict[str, bytes] = {}
        self._held: dict[int, dict[str, bytes]] = {}
        self._latched_done = False
        self._next_step = 0

    @property
    def next_step(self) -> int:
        """The first step that has not been returned yet."""
        return self._next_step

    def _due(self, step: int) -> list[Topic]:
        place = step % self._cycle_steps
        if place not in self._due_at:
            self._due_at[place] = [topic for topic in self._periodic if place % topic.period_steps == 0]
        return self._due_at[place]

    def add(self, topic_name: str, step: int, cdr: bytes) -> None:
        """Add a message.

        Raises EpisodeError: the topic is not expected; the step has a message on it already, is over, cannot have
        begun, or is none of the topic's.
        """
        topic = self._topics.get(topic_name)
        if topic is None:
            raise EpisodeError(f"a message on {topic_name}, which this episode does not record")
        if topic.latched:
            if topic_name in self._held_latched or self._latched_done:
                raise EpisodeError(f"a second message on {topic_name}, which is published once")
            self._held_latched[topic_name] = cdr
            return
        if step < self._next_step or step % topic.period_steps:
            raise EpisodeError(f"a message on {topic_name} for step {step}, where none is due")
        if step > self._next_step + MAX_STEPS_AHEAD:
            raise EpisodeError(f"a message on {topic_name} for step {step}, which has not begun")
        held = self._held.setdefault(step, {})
        if topic_name in held:
            raise EpisodeError(f"two messages on {topic_name} for step {step}")
        held[topic_name] = cdr

    def ready(self) -> Iterator[CollectedMessage]:
        """Yield the messages of all complete steps, in order, each once."""
        if not self._latched_done:
            if len(self._held_latched) < len(self._latched):
                return
            self._latched_done = True
            yield from self._take_latched()
        while len(self._held.get(self._next_step, ())) == len(self._due(self._next_step)):
            yield from self._take_step(self._next_step)

    def drain(self) -> Iterator[CollectedMessage]:
        """Yield all remaining messages in order, also of incomplete steps, for a failed episode."""
        if not self._latched_done:
            self._latched_done = True
            yield from self._take_latched()
        for step in sorted(self._held):
            yield from self._take_step(step)

    def _take_latched(self) -> Iterator[CollectedMessage]:
        for topic in self._latched:
            if topic.name in self._held_latched:
                yield topic, 0, self._held_latched.pop(topic.name)

    def _take_step(self, step: int) -> Iterator[CollectedMessage]:
        held = self._held.pop(step)
        self._next_step = step + 1
        for topic in self._due(step):
            if topic.name in held:
                yield topic, step, held[topic.name]

    def missing(self, last_step: int) -> list[str]:
        """List the missing messages up to and including ``last_step``, each with its publisher and step."""
        latched = [] if self._latched_done else self._latched
        lacking = [(topic, "before step 0") for topic in latched if topic.name not in self._held_latched]
        for step in range(self._next_step, last_step + 1):
            held = self._held.get(step, {})
            lacking += [(topic, f"at step {step}") for topic in self._due(step) if topic.name not in held]
        return [f"{topic.name} of {topic.publisher or 'its publisher'} {when}" for topic, when in lacking]


class EpisodeRecorder:
    """Writes the bag of an episode step by step and judges the episode at its end."""

    def __init__(
        self,
        path: Path | None,
        store: Typestore,
        latched: frozenset[str],
        judge: Callable[[RecordBuilder, EpisodeClosing], EpisodeOutcome],
        decode: Callable[[Topic, bytes], Any] | None = None,
        read: Reading = read_anew,
        options: BagOptions | None = None,
    ) -> None:
        """Open the bag under its temporary name; without a path, ``expect`` sets it and opens the bag.

        Args:
            path: Final folder of the bag.
            store: Definitions of all recorded types.
            latched: Names of the latched topics.
            judge: Gives the outcome, from the messages so far and from how the episode closed.
            decode: Decodes a CDR; by default with the store.
            read: Applies a conversion to a message; may return an earlier result.
            options: How the bag is written.

        Raises BagError: the folder exists already or cannot be written.
        """
        self._store = store
        self._latched = latched | {EPISODE_END.name}
        self._options = options
        self._judge = judge
        self._decode = decode or partial(decode_cdr, store)
        self._writer = None if path is None else EpisodeBagWriter(path, store, self._latched, options)
        self._builder = RecordBuilder(read)
        self._collector: StepCollector | None = None
        self._early: list[tuple[Topic, bytes]] = []
        self.on_step_recorded: Callable[[int], None] = lambda _step: None

    @property
    def _bag(self) -> EpisodeBagWriter:
        if self._writer is None:
            raise EpisodeError("no bag was opened: the episode's description did not arrive")
        return self._writer

    @property
    def steps_recorded(self) -> int:
        """Number of steps whose messages are all recorded."""
        return 0 if self._collector is None else self._collector.next_step

    def expect(self, topics: tuple[Topic, ...], path: Path) -> None:
        """Set the topics of the episode, in the order in which a step's messages are stored.

        The path is the bag's where the constructor got none. Raises BagError as the constructor.
        """
        if self._writer is None:
            self._writer = EpisodeBagWriter(path, self._store, self._latched, self._options)
        self._collector = StepCollector(topics)
        for topic, cdr in self._early:
            self.take(topic, cdr)
        self._early.clear()

    def take(self, topic: Topic, cdr: bytes) -> None:
        """Take a serialised message and write all steps that are now complete.

        Raises EpisodeError: the episode does not expect the message, or the bag cannot be written.
        """
        if self._collector is None:
            if len(self._early) == MAX_EARLY_MESSAGES:
                raise EpisodeError(f"{topic.name}: messages before the episode has begun")
            self._early.append((topic, cdr))
            return
        self._collector.add(topic.name, 0 if topic.latched else step_of_cdr(topic, cdr), cdr)
        done = self._collector.next_step
        for message in self._collector.ready():
            self._write(*message)
        for step in range(done, self._collector.next_step):
            self.on_step_recorded(step)

    def _write(self, topic: Topic, step: int, cdr: bytes) -> None:
        if topic.name in STEERED_FROM_OUTSIDE:  # padding bytes from another program's serialiser are arbitrary
            cdr = encode_cdr(self._store, topic, decode_cdr(self._store, topic, cdr))
        if topic.name in _DECODED:
            self._builder.add(topic.name, self._decode(topic, cdr))
        self._bag.write(topic.name, topic.type_name, cdr, time_ns_of_step(step))

    def discard(self) -> None:
        """Delete the bag of an episode that did not begin."""
        if self._writer is not None:
            self._writer.discard()

    def missing(self, step: int) -> str:
        """The missing messages of a step with their publishers, as text for an error."""
        if self._collector is None:
            return "the episode's description"
        return ", ".join(self._collector.missing(step))

    def _complete(self, closing: EpisodeClosing) -> EpisodeClosing:
        """Compare the reported end of the episode with the recorded steps: it is complete only if all were recorded."""
        if closing.end is not EpisodeEnd.COMPLETE or self._collector is None or self.steps_recorded >= closing.steps:
            return closing
        lacking = self.missing(self.steps_recorded)
        reason = f"{closing.steps} steps were closed, and {self.steps_recorded} are recorded; missing: {lacking}"
        return replace(closing, end=EpisodeEnd.FAILED, reason=reason)

    def close(self, closing: EpisodeClosing) -> tuple[EpisodeOutcome, BagSummary | None, Any]:
        """Judge the episode and close its bag.

        Returns the outcome; the closed bag, None where no step was finished and the bag was removed; and the outcome
        as a message. Raises EpisodeError: the bag cannot be completed, or steps that were closed are not in it. The
        messages so far stay readable under a partial name.
        """
        asked, closing = closing.end, self._complete(closing)
        if closing.steps == 0 and closing.end is not EpisodeEnd.COMPLETE:
            self.discard()
            outcome = EpisodeOutcome(closing.end, closing.reason, 0, None)
            return outcome, None, to_episode_outcome(outcome)
        if closing.end is not EpisodeEnd.COMPLETE and self._collector is not None:
            for collected in self._collector.drain():
                # The message is malformed or the bag cannot be written; `abandon` saves the rest.
                with suppress(SirenError):
                    self._write(*collected)
        outcome = self._judge(self._builder, closing)
        message = to_episode_outcome(outcome)
        cdr = encode_cdr(self._store, OUTCOME, message)
        ending = encode_cdr(self._store, EPISODE_END, to_episode_end(closing))
        try:
            for topic, content in ((EPISODE_END, ending), (OUTCOME, cdr)):
                self._bag.write(topic.name, topic.type_name, content, time_ns_of_step(max(closing.steps - 1, 0)))
            if closing.end is EpisodeEnd.COMPLETE:
                return outcome, self._bag.finish(), message
        except EpisodeError as error:
            self._bag.abandon(str(error))
            raise
        summary = self._bag.abandon(closing.reason)
        if closing.end is not asked:
            raise EpisodeError(closing.reason)
        return outcome, summary, message
