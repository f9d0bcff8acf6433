"""Results of checks on a record: conditions with their numbers, and verdicts of several conditions."""

import math
import re
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from siren_ros.base.numerics.arrays import Brief
from siren_ros.base.numerics.units import STEP_S
from siren_ros.simulation.roads.road_network import OTHER_SIDE
from siren_ros.simulation.world.actors import Event


@dataclass(frozen=True, order=True)
class Moment:
    """An event of an actor at a step."""

    step: int
    actor_id: int
    note: str = ""

    def __str__(self) -> str:
        text = f"{self.actor_id} at {self.step * STEP_S:.1f} s"
        return f"{text} ({self.note})" if self.note else text


def first_reaching(
    steps: npt.NDArray[Any], actor_id: int, values: npt.ArrayLike, threshold: float
) -> tuple[Moment, ...]:
    """The first of some steps at which an actor's value reaches a threshold; empty if it never does."""
    reached = steps[np.asarray(values) >= threshold]
    return tuple(Moment(int(step), actor_id) for step in reached[:1])


def listed(moments: Iterable[Moment]) -> str:
    """Moments as text for users."""
    return ", ".join(map(str, moments))


def moments_of(events: Iterable[Event]) -> tuple[Moment, ...]:
    """Moments of events."""
    return tuple(Moment(event.step, event.actor_id) for event in events)


@dataclass(frozen=True)
class Part(Brief):
    """One condition: the measured number, its threshold, and whether the condition holds."""

    name: str
    value: float
    threshold: float
    holds: bool
    relation: str
    """Required relation of value to threshold: ``>=``, ``>``, ``<=`` or ``=``."""
    detail: str = ""
    """Step and actor of the worst case, or names of what is missing."""
    moments: tuple[Moment, ...] = ()
    """Moments of the counted events; or when another value reached its threshold, or was worst."""

    @property
    def decisive(self) -> Moment | None:
        """The moment that made the condition true or false; the last one if there were too few events."""
        if not self.moments:
            return None
        needed = min(self.threshold, len(self.moments))
        place = math.ceil(needed) - 1 if self.relation.startswith(">") else math.floor(needed)
        return self.moments[min(max(place, 0), len(self.moments) - 1)]

    def __str__(self) -> str:
        text = f"{self.name}: {self.value:.4g} (needs {self.relation} {self.threshold:.4g})"
        return f"{text}, {self.detail}" if self.detail else text


def at_least(name: str, value: float, threshold: float, detail: str = "", *moments: Moment) -> Part:
    """The condition ``value >= threshold``."""
    return Part(name, float(value), float(threshold), bool(value >= threshold), ">=", detail, moments)


def more_than(name: str, value: float, threshold: float, detail: str = "", *moments: Moment) -> Part:
    """The condition ``value > threshold``."""
    return Part(name, float(value), float(threshold), bool(value > threshold), ">", detail, moments)


def at_most(name: str, value: float, threshold: float, detail: str = "", *moments: Moment) -> Part:
    """The condition ``value <= threshold``; a value that is not a number fails."""
    return Part(name, float(value), float(threshold), bool(value <= threshold), "<=", detail, moments)


def equals(name: str, value: float, threshold: float, detail: str = "", *moments: Moment) -> Part:
    """The condition ``value = threshold``."""
    return Part(name, float(value), float(threshold), bool(value == threshold), "=", detail, moments)


@dataclass(frozen=True)
class Verdict(Brief):
    """Whether an interaction happened, with the numbers that decide it."""

    holds: bool
    parts: tuple[Part, ...]
    text: str
    """One sentence for users."""

    def facts(self) -> dict[str, object]:
        """Result, sentence and all numbers as plain values."""
        return {"holds": self.holds, "text": self.text, **{part.name: str(part) for part in self.parts}}

    @property
    def failing(self) -> tuple[Part, ...]:
        """The conditions that do not hold."""
        return tuple(part for part in self.parts if not part.holds)

    def measures(self) -> dict[str, float | int | str]:
        """The parts' values by name, as an episode's outcome stores them."""
        return {part.name: part.value for part in self.parts}


def verdict_of(parts: tuple[Part, ...], text: str) -> Verdict:
    """A verdict of some parts; it holds where all parts hold."""
    return Verdict(all(part.holds for part in parts), parts, text)


_SIDE: Final = re.compile(r"(?:(?<=the )|(?<=turns )|(?<=turned ))(left|right)\b")
"""Matches a side, not the verb: "on the left", "turned right"."""


def with_sides_exchanged(verdict: Verdict) -> Verdict:
    """Exchange "left" and "right" in the verdict on a mirror image, so that it describes the original."""
    parts = tuple(replace(part, detail=_exchanged(part.detail)) for part in verdict.parts)
    return replace(verdict, parts=parts, text=_exchanged(verdict.text))


def _exchanged(text: str) -> str:
    return _SIDE.sub(lambda side: OTHER_SIDE[side.group()], text)


def closest_of(verdicts: Iterable[Verdict]) -> Verdict | None:
    """The verdict that comes closest to holding, among several places or moments of one episode.

    It has the most parts that hold. Of equals it has the largest values, compared part by part; then it is the first.
    None where there is no verdict.
    """

    def closeness(verdict: Verdict) -> tuple[bool, int, tuple[float, ...]]:
        holding = sum(part.holds for part in verdict.parts)
        return verdict.holds, holding, tuple(part.value for part in verdict.parts)

    return max(verdicts, key=closeness, default=None)
