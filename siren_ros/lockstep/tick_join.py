"""Joins a node's inputs by step, so that the order of arrival cannot change what it computes."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Final

from siren_ros.errors import EpisodeError
from siren_ros.interfaces.topics import Topic

MAX_STEPS_AHEAD: Final = 64
"""At most two steps are in flight: another program sent a message beyond this limit, and it is not kept."""


@dataclass(frozen=True)
class Input:
    """A topic a node needs before it acts on a step."""

    topic: Topic
    lag_steps: int = 0
    """1: the message of step k − 1 is an input of step k (and step 0 goes without)."""

    def needed_at(self, step: int) -> bool:
        """Whether this topic brings a message for a step."""
        source = step - self.lag_steps
        return source >= 0 and source % self.topic.period_steps == 0


def once(topic: Topic, earlier: object) -> None:
    """Refuse a second message on a topic that is published once.

    Args:
        topic: Where a message has come.
        earlier: What came on it before; None where nothing did.

    Raises:
        EpisodeError: There was one before: another program publishes on the topic.
    """
    if earlier is not None:
        raise EpisodeError(f"{topic.name}: a second message, although it is published once")


class TickJoin:
    """Collects messages by step and hands out steps whose inputs are complete, in order."""

    def __init__(self, inputs: tuple[Input, ...]) -> None:
        self._inputs = {item.topic.name: item for item in inputs}
        self._waiting: dict[int, dict[str, Any]] = {}
        self.next_step = 0

    def add(self, inputs: tuple[Input, ...]) -> None:
        """Wait for further topics too; only before the first message."""
        self._inputs.update({item.topic.name: item for item in inputs})

    def offer(self, topic_name: str, message_step: int, message: Any) -> Iterator[tuple[int, dict[str, Any]]]:
        """Take in a message; yield every step that is now complete with its messages by topic name.

        Raises:
            EpisodeError: The message belongs to a step that was handed out already or cannot have begun, or came
                twice: the lockstep is broken, or another program publishes on the topic.
        """
        step = message_step + self._inputs[topic_name].lag_steps
        if step > self.next_step + MAX_STEPS_AHEAD:
            raise EpisodeError(f"{topic_name}: a message for step {message_step}, which has not begun")
        slot = self._waiting.setdefault(step, {})
        if step < self.next_step or topic_name in slot:
            raise EpisodeError(f"{topic_name}: a second message for step {message_step}")
        slot[topic_name] = message
        yield from self._complete()

    def _complete(self) -> Iterator[tuple[int, dict[str, Any]]]:
        while self._waiting and not self._lacking():
            messages = self._waiting.pop(self.next_step, {})
            self.next_step += 1
            yield self.next_step - 1, messages

    def missing(self) -> tuple[str, ...]:
        """Topics that the next step still waits for, sorted."""
        return tuple(sorted(self._lacking()))

    def _lacking(self) -> list[str]:
        have, step = self._waiting.get(self.next_step, {}), self.next_step
        return [name for name, item in self._inputs.items() if name not in have and item.needed_at(step)]
