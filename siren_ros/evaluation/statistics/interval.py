"""The names of ``siren_ros.tables.interval``, and a note for tables of text, until all tables are ``Table``."""

from collections.abc import Iterable
from typing import Final

from siren_ros.tables.interval import (
    BLOCKS_MIN,
    CONFIDENCE,
    NOTHING,
    Interval,
    mean_of_intervals,
    share_interval,
)

__all__ = ["BLOCKS_MIN", "CONFIDENCE", "NOTHING", "WHY_NONE", "Interval", "lack_of_bounds"]
__all__ += ["mean_of_intervals", "share_interval"]

WHY_NONE: Final = (
    f"[{{}}] is no interval: it takes {BLOCKS_MIN} episodes, 2 of each template, and values that are not all the same"
)
"""For a reader of tables; with the dash that stands in them."""


def lack_of_bounds(shown: Iterable[Interval]) -> list[str]:
    """The line below a table that has values without bounds, which stand as a dash; no line where all have them."""
    return [] if all(one.bounded for one in shown if one.valid) else [WHY_NONE.format("-")]
