"""How numbers are written in tables of text."""

from collections.abc import Sequence
from typing import Final

from siren_ros.evaluation.statistics.interval import Interval

NONE: Final = "-"
"""Where there is no value."""


def number(value: float | None, digits: int = 2) -> str:
    """A value, or a dash."""
    return NONE if value is None else f"{value:.{digits}f}"


def pair(values: Sequence[float | None]) -> str:
    """``1.44/3.73``."""
    return "/".join(number(value) for value in values)


def bounds(interval: Interval) -> str:
    """``[1.20, 1.66]``, a dash where episodes are too few."""
    if not interval.valid:
        return NONE
    return f"[{interval.low:.2f}, {interval.high:.2f}]" if interval.bounded else f"[{NONE}]"
