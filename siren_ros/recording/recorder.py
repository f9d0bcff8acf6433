"""Records one episode: takes messages in any order, writes a complete bag with its outcome."""

from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, Final

from rosbags.typesys.store import Typestore

from siren_ros.errors import EpisodeError, SirenError
from siren_ros.interfaces.cdr import decode_cdr, encode_cdr, step_of_cdr
from siren_ros.interfaces.episode_conversions import to_episode_end, to_episode_outcome
from siren_ros.interfaces.lockstep_reports import EpisodeClosing
from siren_ros.interfaces.topics import EPISODE_END, OUTCOME, Topic
from siren_ros.numerics.units import time_ns_of_step
from siren_ros.recording.bag_writer import BagSummary, EpisodeBagWriter
from siren_ros.recording.collector import CollectedMessage, StepCollector
from siren_ros.recording.record_builder import RECORD_TOPICS, Reading, RecordBuilder, read_anew
from siren_ros.scenario.episode import EpisodeEnd, EpisodeOutcome

MAX_EARLY_MESSAGES: Final = 1000
"""Most messages that are kept before the episode's topics are known; each latched topic sends one."""
_DECODED = frozenset(topic.name for topic in RECORD_TOPICS)


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
    ) -> None:
        """Opens the bag under its temporary name.

        Args:
            path: Final folder of the bag; None: ``expect`` sets it, and opens the bag.
            store: Definitions of all recorded types.
            latched: Names of the latched topics.
            judge: Gives the outcome, from the messages so far and from how the episode closed.
            decode: Decodes a CDR; by default with the store.
            read: Applies a conversion to a message; may return an earlier result.

        Raises:
            BagError: The folder exists already or cannot be written.
        """
        self._store = store
        self._latched = latched | {EPISODE_END.name}
        self._judge = judge
        self._decode = decode or partial(decode_cdr, store)
        self._writer = None if path is None else EpisodeBagWriter(path, store, self._latched)
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
        """Sets the topics of the episode, in the order in which a step's messages are stored.

        Args:
            topics: Of the episode.
            path: Final folder of the bag, where the constructor got none.

        Raises:
            BagError: As the constructor.
        """
        if self._writer is None:
            self._writer = EpisodeBagWriter(path, self._store, self._latched)
        self._collector = StepCollector(topics)
        early, self._early = self._early, []
        for topic, cdr in early:
            self.take(topic, cdr)

    def take(self, topic: Topic, cdr: bytes) -> None:
        """Takes a serialised message and writes all steps that are now complete.

        Raises:
            EpisodeError: The episode does not expect the message, or the bag cannot be written.
        """
        if self._collector is None:
            if len(self._early) == MAX_EARLY_MESSAGES:
                raise EpisodeError(f"{topic.name}: messages before the episode has begun")
            self._early.append((topic, cdr))
            return
        self._collector.add(topic.name, 0 if topic.latched else step_of_cdr(topic, cdr), cdr)
        done = self._collector.next_step
        for message in self._collector.ready():
            self._write(message)
        for step in range(done, self._collector.next_step):
            self.on_step_recorded(step)

    def _write(self, message: CollectedMessage) -> None:
        name, type_name = message.topic.name, message.topic.type_name
        if name in _DECODED:
            self._builder.add(name, self._decode(message.topic, message.cdr))
        self._bag.write(name, type_name, message.cdr, time_ns_of_step(message.step))

    def discard(self) -> None:
        """Removes the bag; for an episode that did not begin."""
        if self._writer is not None:
            self._writer.discard()

    def missing(self, step: int) -> str:
        """The missing messages of a step with their publishers, as text for an error."""
        if self._collector is None:
            return "the episode's description"
        return ", ".join(str(item) for item in self._collector.missing(step))

    def _complete(self, closing: EpisodeClosing) -> EpisodeClosing:
        """How the episode closed, held against the steps that are recorded: reports alone do not make it complete."""
        if closing.end is not EpisodeEnd.COMPLETE or self._collector is None or self.steps_recorded >= closing.steps:
            return closing
        lacking = self.missing(self.steps_recorded)
        reason = f"{closing.steps} steps were closed, and {self.steps_recorded} are recorded; missing: {lacking}"
        return replace(closing, end=EpisodeEnd.FAILED, reason=reason)

    def close(self, closing: EpisodeClosing) -> tuple[EpisodeOutcome, BagSummary | None, Any]:
        """Judges the episode and closes its bag.

        Returns:
            The outcome; the closed bag, None where no step was finished and the bag was removed; and the outcome
            as a message.

        Raises:
            EpisodeError: The bag cannot be completed, or steps that were closed are not in it. The messages so far
                stay readable under a partial name.
        """
        asked, closing = closing.end, self._complete(closing)
        if closing.steps == 0 and closing.end is not EpisodeEnd.COMPLETE:
            self.discard()
            outcome = EpisodeOutcome(closing.end, closing.reason, 0, None)
            return outcome, None, to_episode_outcome(outcome)
        if closing.end is not EpisodeEnd.COMPLETE and self._collector is not None:
            for message in self._collector.drain():
                with suppress(SirenError):  # malformed, or the bag cannot be written: `abandon` saves what there is
                    self._write(message)
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
