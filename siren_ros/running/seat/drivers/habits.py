"""What a driver does before an emergency vehicle: the habits of the law of a place, and what each fault changes."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Final


@dataclass(frozen=True)
class Habits:
    """Habits of a driver that makes way; the defaults are lawful everywhere but for what a place asks besides."""

    by_lane: bool = False
    """Whether it stays in its lane on roads where a rescue lane is opened: at the left in the leftmost one, else at the
    right. Elsewhere it goes to the right edge of the road."""
    splits_queues: bool = False
    """Whether it opens a way between queues on every road: it goes to the left where it cannot get to the right, close
    to the line, drives on slowly where an EMV does not get past it, and goes back behind one that stands in traffic."""
    uses_shoulder: bool = True
    """Whether the shoulder belongs to that road."""
    hears: bool = True
    heard_m: float = 40.0
    """Gap at which it notices a siren behind it."""
    reaction_s: float = 0.8
    other_side: bool = False
    """Whether it makes way to the side that the law does not name."""
    clears_junctions: bool = True
    """Whether it drives on where it would come to stand in a junction."""
    stops: bool = True
    """Whether it stands while an EMV comes, or goes on slowly."""
    brakes_mps2: float = 3.5
    """Of the hardest braking while it makes way."""
    brakes_at_once: bool = False
    """Whether it brakes to a stop where it is before it makes way."""
    signals: bool = True
    waits_for_all: bool = True
    """Whether it stays aside until the last EMV has passed."""
    apart_m: float = 30.0
    """Kept to an EMV that has passed: it stays aside until then, and does not come nearer."""
    chases: bool = False
    """Whether it drives behind an EMV that has passed, as fast as that."""
    stops_at_red: bool = True
    returns: bool = True
    """Whether it goes back into its lane when the last EMV has passed."""


HABITS: Final[Mapping[str, Habits]] = {
    "california": Habits(apart_m=100.0),
    "germany": Habits(by_lane=True, splits_queues=True, uses_shoulder=False),
    "international": Habits(splits_queues=True),
}
"""Of lawful drivers, by the rulebook of the place."""

FAULTS: Final[Mapping[str, Mapping[str, Any]]] = {
    "ignores": {"hears": False, "apart_m": 0.0},
    "stops-in-the-junction": {"clears_junctions": False},
    "wrong-side": {"other_side": True},
    "leaves-early": {"waits_for_all": False},
    "runs-red": {"stops_at_red": False},
    "opens-late": {"reaction_s": 9.0},
    "blocks-the-shoulder": {"uses_shoulder": True},
    "no-indicator": {"signals": False},
    "brakes-hard": {"brakes_mps2": 8.5, "brakes_at_once": True},
    "follows": {"apart_m": 0.0, "chases": True},
    "never-returns": {"returns": False},
    "creeps": {"stops": False},
}
"""What each fault changes in the habits of a lawful driver, by name."""


def faulty(habits: Habits, fault: str) -> Habits:
    """The habits with a fault."""
    return replace(habits, **FAULTS[fault])
