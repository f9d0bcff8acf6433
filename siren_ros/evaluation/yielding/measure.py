"""One measured number, which may have no value."""

from dataclasses import dataclass
from typing import Self


@dataclass(frozen=True)
class Measure:
    """A number of an episode. Where nothing could be measured ``value`` is 0, means nothing, and ``lack`` says why."""

    value: float
    lack: str = ""
    at_least: bool = False
    """Whether the episode ended before the value was complete: it is a lower bound."""

    @property
    def valid(self) -> bool:
        """Whether there is a value."""
        return not self.lack

    @classmethod
    def lacking(cls, reason: str) -> Self:
        """No value."""
        return cls(0.0, reason)
