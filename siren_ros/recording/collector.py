"""Collects the messages of each step and gives them out in a fixed order, independent of their arrival."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from siren_ros.errors import EpisodeError
from siren_ros.interfaces.topics import OUTCOME, Topic
from siren_ros.lockstep.tick_join import MAX_STEPS_AHEAD


@dataclass(frozen=True)
class CollectedMessage:
    """A serialised message that is ready to be recorded."""

    topic: Topic
    step: int
    cdr: bytes


@dataclass(frozen=True)
class MissingMessage:
    """A message that has not arrived."""

    topic: Topic
    step: int

    def __str__(self) -> str:
        when = "before step 0" if self.topic.latched else f"at step {self.step}"
        return f"{self.topic.name} of {self.topic.publisher or 'its publisher'} {when}"


class StepCollector:
    """Orders the messages of an episode: latched topics first, then step by step, topics in a fixed order.

    The collector does not wait for the outcome; the recorder writes it after all other messages.
    """

    def __init__(self, topics: Sequence[Topic]) -> None:
        """Takes the recorded topics of an episode, in the order in which a step's messages are stored."""
        expected = [topic for topic in topics if topic.name != OUTCOME.name]
        self._topics = {topic.name: topic for topic in expected}
        self._latched = [topic for topic in expected if topic.latched]
        self._periodic = [topic for topic in expected if not topic.latched]
        self._cycle_steps = math.lcm(*(topic.period_steps for topic in self._periodic))
        self._due_at: dict[int, list[Topic]] = {}
        self._held_latched: dict[str, bytes] = {}
        self._held: dict[int, dict[str, bytes]] = {}
        self._latched_done = False
        self._next_step = 0

    @property
    def next_step(self) -> int:
        """The first step that has not been given out."""
        return self._next_step

    @property
    def pending_steps(self) -> tuple[int, ...]:
        """Incomplete steps of which some messages have arrived."""
        return tuple(sorted(self._held))

    def _due(self, step: int) -> list[Topic]:
        place = step % self._cycle_steps
        due = self._due_at.get(place)
        if due is None:
            due = self._due_at[place] = [topic for topic in self._periodic if place % topic.period_steps == 0]
        return due

    def add(self, topic_name: str, step: int, cdr: bytes) -> None:
        """Takes a message.

        Raises:
            EpisodeError: The topic is not expected; the step has a message on it already, is over, cannot have
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
        """Gives out all messages of the complete steps, in order; each message once."""
        if not self._latched_done:
            if len(self._held_latched) < len(self._latched):
                return
            self._latched_done = True
            yield from self._take_latched()
        while self._is_complete(self._next_step):
            yield from self._take_step(self._next_step)

    def drain(self) -> Iterator[CollectedMessage]:
        """Gives out all remaining messages in order, also of incomplete steps; for an episode that failed."""
        if not self._latched_done:
            self._latched_done = True
            yield from self._take_latched()
        for step in sorted(self._held):
            yield from self._take_step(step)

    def _take_latched(self) -> Iterator[CollectedMessage]:
        for topic in self._latched:
            if topic.name in self._held_latched:
                yield CollectedMessage(topic, 0, self._held_latched.pop(topic.name))

    def _take_step(self, step: int) -> Iterator[CollectedMessage]:
        held = self._held.pop(step)
        self._next_step = step + 1
        for topic in self._due(step):
            if topic.name in held:
                yield CollectedMessage(topic, step, held[topic.name])

    def _is_complete(self, step: int) -> bool:
        held = self._held.get(step)
        return held is not None and len(held) == len(self._due(step))

    def _missing_at(self, step: int) -> list[Topic]:
        held = self._held.get(step, {})
        return [topic for topic in self._due(step) if topic.name not in held]

    def missing(self, last_step: int) -> tuple[MissingMessage, ...]:
        """All missing messages of the steps up to and including ``last_step``."""
        latched = [] if self._latched_done else self._latched
        lacking = [MissingMessage(topic, 0) for topic in latched if topic.name not in self._held_latched]
        for step in range(self._next_step, last_step + 1):
            lacking += [MissingMessage(topic, step) for topic in self._missing_at(step)]
        return tuple(lacking)
