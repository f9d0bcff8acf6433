"""Why an actor drives as it does at one step: what limits its speed, and which guards of its algorithm acted.

A page takes reasons where somebody has them; it shows none where they are missing.
"""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Final

from siren_ros.episode_page.columns import ColumnFile
from siren_ros.world.actors import NO_ACTOR

_SPEED_UNIT_MPS: Final = 0.01
_FASTEST_MPS: Final = 1000.0
"""A limit that does not bind may be infinite."""


@dataclass(frozen=True)
class SpeedLimit:
    """One mechanism that limits a speed."""

    mechanism: str
    speed_mps: float
    blocker_id: int = NO_ACTOR
    """The actor because of which it does so."""


@dataclass(frozen=True)
class Guard:
    """One guard of an algorithm: whether it acted, and why or why not."""

    name: str
    acts: bool
    why: str = ""


@dataclass(frozen=True)
class Reasons:
    """The decision of one actor at one step."""

    step: int
    actor_id: int
    target_mps: float
    """NaN where it has no target, because SUMO drives."""
    limits: tuple[SpeedLimit, ...] = ()
    guards: tuple[Guard, ...] = ()
    """In the order in which they were tried."""


def add_reasons(file: ColumnFile, reasons: Iterable[Reasons]) -> Mapping[str, Any]:
    """Adds the columns ``why.*``; for the head the names that they count, or nothing where there are no reasons."""
    rows = sorted(reasons, key=lambda reason: (reason.actor_id, reason.step))
    if not rows:
        return {}
    limits = [limit for row in rows for limit in row.limits]
    guards = [guard for row in rows for guard in row.guards]
    mechanisms = sorted({limit.mechanism for limit in limits})
    texts = sorted({text for guard in guards for text in (guard.name, guard.why)})
    numbers = {text: number for number, text in enumerate(texts)}
    file.add("why.actor", [row.actor_id for row in rows])
    file.add("why.step", [row.step for row in rows])
    file.add("why.target_mps", [_bounded(row.target_mps) for row in rows], _SPEED_UNIT_MPS)
    file.add("why.limits", [len(row.limits) for row in rows])
    file.add("why.guards", [len(row.guards) for row in rows])
    file.add("limit.mechanism", [mechanisms.index(limit.mechanism) for limit in limits])
    file.add("limit.speed_mps", [_bounded(limit.speed_mps) for limit in limits], _SPEED_UNIT_MPS)
    file.add("limit.blocker", [limit.blocker_id for limit in limits])
    file.add("guard.name", [numbers[guard.name] for guard in guards])
    file.add("guard.acts", [guard.acts for guard in guards])
    file.add("guard.why", [numbers[guard.why] for guard in guards])
    return {"why": {"mechanisms": mechanisms, "texts": texts}}


def _bounded(speed_mps: float) -> float:
    """A speed that a column can hold; -1 for none."""
    return -1.0 if math.isnan(speed_mps) else min(max(speed_mps, 0.0), _FASTEST_MPS)
