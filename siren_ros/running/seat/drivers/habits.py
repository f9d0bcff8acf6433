"""Habits of a driver towards emergency vehicles: those of each place's law, and how each fault changes them."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Final


@dataclass(frozen=True)
class Habits:
    """Habits of a driver that makes way. The defaults are lawful everywhere, except for further demands of a place."""

    by_lane: bool = False
    """Whether it stays in its lane on roads where a rescue lane is required: at the left of the leftmost lane,
    otherwise at the right. On other roads it goes to the right edge."""
    splits_queues: bool = False
    """Whether it opens a path between queues on every road: if the right is blocked it goes to the left, close to the
    line; it drives on slowly if an EMV cannot pass; and it returns behind an EMV that stands in traffic."""
    uses_shoulder: bool = True
    """Whether it also uses the shoulder as road."""
    hears: bool = True
    heard_m: float = 40.0
    """Gap at which it notices a siren behind it."""
    reaction_s: float = 0.8
    other_side: bool = False
    """Whether it makes way to the wrong side."""
    clears_junctions: bool = True
    """Whether it drives on instead of stopping in a junction."""
    stops: bool = True
    """Whether it stops while an EMV comes; otherwise it drives on slowly."""
    brakes_mps2: float = 3.5
    """Hardest braking while it makes way."""
    brakes_at_once: bool = False
    """Whether it brakes to a stop at once, before it makes way."""
    signals: bool = True
    waits_for_all: bool = True
    """Whether it stays at the side until the last EMV has passed."""
    apart_m: float = 30.0
    """Distance to an EMV that has passed: it stays at the side until then, and keeps at least this distance."""
    chases: bool = False
    """Whether it follows an EMV that has passed, at the same speed."""
    stops_at_red: bool = True
    returns: bool = True
    """Whether it returns to its lane after the last EMV has passed."""


HABITS: Final[Mapping[str, Habits]] = {
    "california": Habits(apart_m=100.0),
    "germany": Habits(by_lane=True, splits_queues=True, uses_shoulder=False),
    "international": Habits(splits_queues=True),
}
"""Habits of lawful drivers by the place of the rulebook."""

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
"""Changes of a lawful driver's habits by name of the fault."""


def faulty(habits: Habits, fault: str) -> Habits:
    """The habits with a fault."""
    return replace(habits, **FAULTS[fault])
