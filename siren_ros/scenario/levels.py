"""Emergency levels and what they switch on (paper, table "Level-Dependent Control in SIREN")."""

from dataclasses import dataclass
from enum import IntEnum, StrEnum
from typing import Final


class EmergencyLevel(IntEnum):
    """The configuration axis of the behaviour model."""

    L0 = 0
    L1 = 1
    L2 = 2
    L3 = 3


class CivilianResponse(StrEnum):
    """What civilians do about an EMV that sounds its siren."""

    NOMINAL = "nominal"
    FEASIBLE_YIELD = "feasible_yield"
    PULL_OVER = "pull_over"


@dataclass(frozen=True)
class LevelPolicy:
    """One row of the paper's table of levels."""

    siren: bool
    privileged: bool
    corridor: bool
    """Whether ``copy_sumo`` and ``gap_escape`` are available."""
    response: CivilianResponse


LEVEL_POLICIES: Final[dict[EmergencyLevel, LevelPolicy]] = {
    EmergencyLevel.L0: LevelPolicy(False, False, False, CivilianResponse.NOMINAL),
    EmergencyLevel.L1: LevelPolicy(False, True, False, CivilianResponse.NOMINAL),
    EmergencyLevel.L2: LevelPolicy(True, True, False, CivilianResponse.FEASIBLE_YIELD),
    EmergencyLevel.L3: LevelPolicy(True, True, True, CivilianResponse.PULL_OVER),
}
