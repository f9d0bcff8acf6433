"""Playing a bag in time: where the playhead is at a moment of wall time, and which messages come in which order."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Final

from siren_ros.numerics.units import STEP_NS
from siren_ros.recording.bag_reader import BagMessage, OpenBag

MAX_BURST_NS: Final = 4 * STEP_NS
"""Simulated time that is published at once at most: a subscriber keeps 8 messages of a topic and must not lose one."""
NS_PER_S: Final = 1_000_000_000


@dataclass(frozen=True)
class Playhead:
    """A place in simulated time that moves with the wall clock, unless it is paused."""

    position_ns: int
    """Simulated time at ``since_s``."""
    since_s: float
    """Wall time."""
    rate: float
    """Simulated seconds per wall second."""
    paused: bool = False

    def advance(self, now_s: float) -> "Playhead":
        """The playhead at a later wall time; after a long delay it slips rather than jumps."""
        if self.paused:
            return replace(self, since_s=now_s)
        moved_ns = round((now_s - self.since_s) * self.rate * NS_PER_S)
        return replace(self, position_ns=self.position_ns + min(moved_ns, MAX_BURST_NS), since_s=now_s)

    def held_at(self, time_ns: int) -> "Playhead":
        """No further than a message that cannot go out yet: time stands still until it can."""
        return replace(self, position_ns=min(self.position_ns, time_ns))

    def pause(self, now_s: float, paused: bool) -> "Playhead":
        """Stopped where it is now, or going on from there."""
        return replace(self.advance(now_s), paused=paused)


def messages_from(bag: OpenBag, start_ns: int) -> Iterator[BagMessage]:
    """What a subscriber that joined at a time would get: what is latched by then, then everything from there on.

    Raises:
        BagError: The bag is damaged at the place that has been reached.
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
