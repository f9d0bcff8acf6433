"""Stores the reasons of drivers' decisions as columns: what limits the speed at each step, and each guard's result."""

import math
from collections.abc import Iterable, Mapping
from typing import Any, Final

from siren_ros.reports.episode_page.columns import ColumnFile
from siren_ros.running.generation.decisions import Decision
from siren_ros.simulation.behaviour.driving.free_space import SpeedLimit

Decisions = Iterable[tuple[int, Mapping[int, Decision]]]
"""Decisions as ``decisions_of`` gives them: each step with its decisions by actor."""
_SPEED_UNIT_MPS: Final = 0.01
_FASTEST_MPS: Final = 60.0
"""Speed limits above this are left out, since no vehicle drives faster."""


def add_reasons(file: ColumnFile, decisions: Decisions) -> Mapping[str, Any]:
    """Add the columns ``why.*``; returns the names that they refer to, or an empty head without decisions."""
    by_step = [(actor, step, decision) for step, decided in decisions for actor, decision in decided.items()]
    rows = sorted(by_step, key=lambda row: row[:2])
    if not rows:
        return {}
    limited = [_that_limit(decision) for _, _, decision in rows]
    limits = [limit for each in limited for limit in each.items()]
    guards = [guard for _, _, decision in rows for guard in decision.guards]
    mechanisms = sorted({mechanism for mechanism, _ in limits})
    texts = sorted({text for guard in guards for text in (guard.name, guard.why)})
    numbers = {text: number for number, text in enumerate(texts)}
    file.add("why.actor", [actor for actor, _, _ in rows])
    file.add("why.step", [step for _, step, _ in rows])
    file.add("why.target_mps", [_bounded(decision.target_mps) for _, _, decision in rows], _SPEED_UNIT_MPS)
    file.add("why.limits", [len(each) for each in limited])
    file.add("why.guards", [len(decision.guards) for _, _, decision in rows])
    file.add("limit.mechanism", [mechanisms.index(mechanism) for mechanism, _ in limits])
    file.add("limit.speed_mps", [_bounded(limit.speed_mps) for _, limit in limits], _SPEED_UNIT_MPS)
    file.add("limit.blocker", [limit.blocker_id for _, limit in limits])
    file.add("guard.name", [numbers[guard.name] for guard in guards])
    file.add("guard.acts", [guard.acts for guard in guards])
    file.add("guard.why", [numbers[guard.why] for guard in guards])
    return {"why": {"mechanisms": mechanisms, "texts": texts}}


def _that_limit(decision: Decision) -> Mapping[str, SpeedLimit]:
    return {name: limit for name, limit in decision.limits.items() if limit.speed_mps <= _FASTEST_MPS}


def _bounded(speed_mps: float) -> float:
    """A speed in the range of a column; -1 for none, where SUMO drives."""
    return -1.0 if math.isnan(speed_mps) else min(max(speed_mps, 0.0), _FASTEST_MPS)
