"""How numbers are written in the page's tables."""

from collections.abc import Sequence
from typing import Final

from siren_ros.evaluation.statistics.interval import Interval, share_interval

NONE: Final = "–"
"""Where there is no value."""


def number(value: float | None, digits: int = 2) -> str:
    """A value, or a dash."""
    return NONE if value is None else f"{value:.{digits}f}"


def with_interval(found: Interval, digits: int = 2, sign: str = "") -> str:
    """``2.28 [2.10, 2.43]``, ``2.28 [–]`` where episodes are too few; ``sign`` is ``+`` where a plus is written."""
    if not found.valid:
        return NONE
    value = f"{found.value:{sign}.{digits}f}"
    return (
        f"{value} [{found.low:{sign}.{digits}f}, {found.high:{sign}.{digits}f}]"
        if found.bounded
        else f"{value} [{NONE}]"
    )


def share_of(part: int, whole: int) -> str:
    """``17 of 20 [64, 95] %``: the interval is that of the share."""
    found = share_interval(part, whole)
    if not found.valid:
        return NONE
    bounds = f"[{100.0 * found.low:.0f}, {100.0 * found.high:.0f}] %" if found.bounded else f"[{NONE}]"
    return f"{part} of {whole} {bounds}"


def pair(values: Sequence[float | None]) -> str:
    """``1.44/3.73``."""
    return "/".join(map(number, values))


def count_of(number_of: int, one: str) -> str:
    """``1 episode``, ``2 episodes``."""
    return f"{number_of:,} {one}{'' if number_of == 1 else 's'}"
