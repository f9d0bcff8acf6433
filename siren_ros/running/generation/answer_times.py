"""Measures how fast the AV's program answers: wall time from a step's states to its answer."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Self

import numpy as np

_LINE: Final = re.compile(
    r"answers of the AV's program after ([\d.]+) ms \(median\), ([\d.]+) ms \(95 %\), ([\d.]+) ms \(worst\)"
)


@dataclass(frozen=True)
class AnswerTimes:
    """Answer times of one episode in milliseconds of wall time."""

    median_ms: float
    p95_ms: float
    worst_ms: float

    @classmethod
    def of(cls, times_s: Sequence[float]) -> Self:
        """Compute them from the answers of an episode; at least one."""
        median, p95, worst = np.percentile(times_s, (50.0, 95.0, 100.0)) * 1000.0
        return cls(round(float(median), 1), round(float(p95), 1), round(float(worst), 1))

    @property
    def line(self) -> str:
        """The times as a line of an episode's summary."""
        told = f"{self.median_ms:.1f} ms (median), {self.p95_ms:.1f} ms (95 %), {self.worst_ms:.1f} ms (worst)"
        return f"answers of the AV's program after {told}"

    @classmethod
    def in_lines(cls, lines: Sequence[str]) -> Self | None:
        """Read the times from a summary; None if it has no such line."""
        found = [match for line in lines if (match := _LINE.search(line))]
        return cls(*map(float, found[-1].groups())) if found else None
