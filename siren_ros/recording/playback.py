"""Playback of a bag: the playhead's position at a wall time, and the order of the messages."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Final

from siren_ros.numerics.units import STEP_NS
from siren_ros.recording.bag_reader import BagMessage, OpenBag

MAX_BURST_NS: Final = 4 * STEP_NS
"""Most simulated time that is published at once; a subscriber keeps 8 messages of a topic."""
NS_PER_S: Final = 1_000_000_000


@dataclass(frozen=True)
class Playhead:
    """A position in simulated time. It moves with the wall clock unless it is paused."""

    position_ns: int
    """Simulated time at ``since_s``."""
    since_s: float
    """Wall time."""
    rate: float
    """Simulated seconds per wall second."""
    paused: bool = False

    def advance(self, now_s: float) -> "Playhead":
        """The playhead at a later wall time. It advances by at most ``MAX_BURST_NS``, also after a long delay."""
        if self.paused:
            return replace(self, since_s=now_s)
        moved_ns = round((now_s - self.since_s) * self.rate * NS_PER_S)
        return replace(self, position_ns=self.position_ns + min(moved_ns, MAX_BURST_NS), since_s=now_s)

    def held_at(self, time_ns: int) -> "Playhead":
        """The playhead, at most at the time of a message that cannot be published yet."""
        return replace(self, position_ns=min(self.position_ns, time_ns))

    def pause(self, now_s: float, paused: bool) -> "Playhead":
        """The playhead paused at its present position, or resumed from there."""
        return replace(self.advance(now_s), paused=paused)


def messages_from(bag: OpenBag, start_ns: int) -> Iterator[BagMessage]:
    """The messages for a subscriber that joins at a time: latched ones from before, then all from there on.

    Raises:
        BagError: The bag is damaged after the last message that was returned.
    """
    earlier: dict[str, BagMessage] = {}
    began = False
    for message in bag.messages():
        if message.time_ns < start_ns:
            if message.topic in bag.latched:
                earlier[message.topic] = message
            continue
        if not began:
            began = True
            yield from earlier.values()
        yield message
    if not began:
        yield from earlier.values()
