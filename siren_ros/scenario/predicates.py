"""The predicates that a template may name, each with its thresholds and their limits."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from siren_ros.scenario.levels import EmergencyLevel


@dataclass(frozen=True)
class PredicateDeclaration:
    """A predicate as templates and records name it; ``siren_ros.judging`` evaluates it."""

    name: str
    thresholds: Mapping[str, tuple[float, float]]
    """Smallest and largest value that a template may give each threshold."""
    needs: EmergencyLevel = EmergencyLevel.L1
    """Least level at which the cause of the interaction exists; below it the predicate must not hold."""


_SPEED_MIN: Final = {"speed_min_mps": (0.1, 20.0)}

QUEUES_SPLIT: Final = PredicateDeclaration(
    "queues_split", {"holding_min": (1, 50), "overtaken_min": (1, 50), "lateral_max_m": (0.1, 5.0)}, EmergencyLevel.L3
)
LANE_CLEARED: Final = PredicateDeclaration(
    "lane_cleared", {"lane_changes_min": (1, 50), "passed_min": (1, 50)}, EmergencyLevel.L2
)
RED_SAME_DIRECTION: Final = PredicateDeclaration("red_same_direction", {})
RED_CROSSING: Final = PredicateDeclaration("red_crossing", {})
STOP_SAME_DIRECTION: Final = PredicateDeclaration("stop_same_direction", _SPEED_MIN)
STOP_CROSSING: Final = PredicateDeclaration("stop_crossing", _SPEED_MIN)
SHOULDER_TURN: Final = PredicateDeclaration("shoulder_turn", {"shoulder_min_s": (0.1, 60.0)})

DECLARED_PREDICATES: Final[dict[str, PredicateDeclaration]] = {
    declared.name: declared
    for declared in (
        QUEUES_SPLIT,
        LANE_CLEARED,
        RED_SAME_DIRECTION,
        RED_CROSSING,
        STOP_SAME_DIRECTION,
        STOP_CROSSING,
        SHOULDER_TURN,
    )
}
"""By name."""
