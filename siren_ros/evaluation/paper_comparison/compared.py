"""One number of the paper next to ours."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from siren_ros.evaluation.statistics.interval import NOTHING, Interval


@dataclass(frozen=True)
class Compared:
    """One row."""

    table: str
    """Of the paper, or what the paper says in its text: ``ADE in m``."""
    row: str
    """``CV``, ``PointPillars``."""
    column: str
    """``S1``, ``mean``."""
    paper: float
    ours: Interval = NOTHING
    """Not valid where it was not measured."""
    digits: int = 2
    relative: bool = True
    """Whether ours divided by the paper's says something, which it does not of a rank correlation."""
    map: str = ""
    """Of our episodes, several by commas; empty where the scores do not say."""

    @property
    def deviation(self) -> float | None:
        """Of ours from the paper's: +0.4 is 40 % above; None where that says nothing, or the paper has 0."""
        return self.ours.value / self.paper - 1.0 if self.relative and self.ours.valid and self.paper else None

    @property
    def inside(self) -> bool | None:
        """Whether the paper's value lies in our interval; None without one."""
        return self.ours.low <= self.paper <= self.ours.high if self.ours.bounded else None

    def cells(self) -> tuple[str, ...]:
        """The row as text."""
        shown = f".{self.digits}f"
        ours = f"{self.ours.value:{shown}}" if self.ours.valid else "-"
        if self.ours.valid:
            ours += f" [{self.ours.low:{shown}}, {self.ours.high:{shown}}]" if self.ours.bounded else " [-]"
        deviation = "" if self.deviation is None else f"{self.deviation:+.0%}"
        inside = {None: "", True: "yes", False: "no"}[self.inside]
        return self.table, self.row, self.column, f"{self.paper:{shown}}", ours, deviation, inside

    def to_json(self) -> dict[str, Any]:
        """The row as JSON types; null where there is no value."""
        return {
            "table": self.table,
            "row": self.row,
            "column": self.column,
            "map": self.map,
            "paper": self.paper,
            "ours": self.ours.value if self.ours.valid else None,
            "low": self.ours.low if self.ours.bounded else None,
            "high": self.ours.high if self.ours.bounded else None,
            "episodes": self.ours.blocks,
            "deviation": self.deviation,
            "paper_inside": self.inside,
        }


HEAD = ("table", "row", "column", "paper", "ours [95 %]", "deviation", "paper inside")
"""Of the cells."""


def measured(rows: Sequence[Compared]) -> list[Compared]:
    """Those rows that have a value of ours."""
    return [row for row in rows if row.ours.valid]
