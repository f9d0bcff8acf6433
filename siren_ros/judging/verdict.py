"""Results of checks on a record: a number, its threshold, and whether it holds."""

from collections.abc import Iterable
from dataclasses import dataclass


@dataclass(frozen=True)
class Part:
    """One condition with the number that was found and the one that it is held against."""

    name: str
    value: float
    threshold: float
    holds: bool
    relation: str
    """``>=``, ``>``, ``<=`` or ``=``: how the value has to stand to the threshold."""
    detail: str = ""
    """Where the value was found: step and actor of the worst case, names of what is missing."""

    def __str__(self) -> str:
        found = f"{self.name}: {self.value:.4g} (needs {self.relation} {self.threshold:.4g})"
        return f"{found}, {self.detail}" if self.detail else found


def at_least(name: str, value: float, threshold: float, detail: str = "") -> Part:
    """The condition ``value >= threshold``."""
    return Part(name, float(value), float(threshold), bool(value >= threshold), ">=", detail)


def more_than(name: str, value: float, threshold: float, detail: str = "") -> Part:
    """The condition ``value > threshold``."""
    return Part(name, float(value), float(threshold), bool(value > threshold), ">", detail)


def at_most(name: str, value: float, threshold: float, detail: str = "") -> Part:
    """The condition ``value <= threshold``; a value that is not a number fails."""
    return Part(name, float(value), float(threshold), bool(value <= threshold), "<=", detail)


def equals(name: str, value: float, threshold: float, detail: str = "") -> Part:
    """The condition ``value = threshold``."""
    return Part(name, float(value), float(threshold), bool(value == threshold), "=", detail)


@dataclass(frozen=True)
class Verdict:
    """Whether an interaction happened, and by which numbers."""

    holds: bool
    parts: tuple[Part, ...]
    text: str
    """One sentence for people."""

    @property
    def failing(self) -> tuple[Part, ...]:
        """The conditions that do not hold."""
        return tuple(part for part in self.parts if not part.holds)

    def measures(self) -> dict[str, float | int | str]:
        """The parts' values by name, as an episode's outcome stores them."""
        return {part.name: part.value for part in self.parts}


def verdict_of(parts: tuple[Part, ...], text: str) -> Verdict:
    """The verdict that holds where all parts hold."""
    return Verdict(all(part.holds for part in parts), parts, text)


def closest_of(verdicts: Iterable[Verdict]) -> Verdict | None:
    """Of several places or moments where an interaction may have happened, the one that came closest.

    That is the one with the most parts that hold, then the one with the largest values in the order of its parts,
    then the first; None of none.
    """

    def closeness(verdict: Verdict) -> tuple[bool, int, tuple[float, ...]]:
        holding = sum(part.holds for part in verdict.parts)
        return verdict.holds, holding, tuple(part.value for part in verdict.parts)

    return max(verdicts, key=closeness, default=None)
