"""The paper's tables: emergency levels and what they switch on, control constants and target speeds, to the number."""

from dataclasses import dataclass, field
from enum import IntEnum, StrEnum
from math import radians
from typing import Final

from siren_ros.base.numerics.units import mps_from_kmh

TEMPLATES: Final = ("S1", "S2", "S3", "S4", "S5", "S6", "S7")
"""Names of the paper's templates."""


class EmergencyLevel(IntEnum):
    """The emergency levels L0 to L3, by which the behaviour model is configured."""

    L0 = 0
    L1 = 1
    L2 = 2
    L3 = 3


def level_name(word: object) -> str:
    """The name ``L2`` of a level that somebody calls ``2``, ``"2"`` or ``"l2"``; any other word as it is."""
    text = str(word)
    name = f"L{text.upper().removeprefix('L')}"
    return name if name in EmergencyLevel.__members__ else text


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
    """Whether the modes ``copy_sumo`` and ``gap_escape`` are available."""
    response: CivilianResponse


LEVEL_POLICIES: Final[dict[EmergencyLevel, LevelPolicy]] = {
    EmergencyLevel.L0: LevelPolicy(False, False, False, CivilianResponse.NOMINAL),
    EmergencyLevel.L1: LevelPolicy(False, True, False, CivilianResponse.NOMINAL),
    EmergencyLevel.L2: LevelPolicy(True, True, False, CivilianResponse.FEASIBLE_YIELD),
    EmergencyLevel.L3: LevelPolicy(True, True, True, CivilianResponse.PULL_OVER),
}


@dataclass(frozen=True)
class GapEscapeConstants:
    """Paper, table "Control constants used by the co-simulation", part "EMV gap_escape"."""

    blocked_speed_mps: float = 0.5
    """v_stop: at or below it the EMV counts as stopped."""
    stop_before_entry_s: float = 3.0
    """t_stop: sustained stop before entry."""
    blocker_grace_s: float = 2.0
    """t_grace: time without a blocker before exit."""


@dataclass(frozen=True)
class ControlConstants:
    """Paper, table "Control constants used by the co-simulation"."""

    region_enter_m: float = 40.0
    """Interaction region: an actor enters at this distance from the EMV."""
    region_leave_m: float = 50.0
    """Interaction region: an actor leaves at this distance from the EMV."""
    leader_query_m: float = 80.0
    """How far ahead SUMO is asked for the EMV's leader."""
    lane_change_cooldown_s: float = 2.0
    """Least time between two forced lane changes of one vehicle."""
    emv_passed_clearance_m: float = 1.0
    """Clearance behind an EMV in the guard ``EmvFullyPassed``."""
    heading_aligned_rad: float = radians(8.0)
    """Largest error of ``HeadingAligned``."""
    gap_escape: GapEscapeConstants = field(default_factory=GapEscapeConstants)


@dataclass(frozen=True)
class TargetSpeeds:
    """Paper, table "Per-mode target speeds enforced by the shared waypoint navigator"."""

    emv_route_follow_mps: float = mps_from_kmh(50.0)
    """EMV, next-link route following."""
    emv_lane_change_mps: float = mps_from_kmh(50.0)
    """EMV, intent-override lane change."""
    emv_copy_sumo_mps: float = mps_from_kmh(30.0)
    """Speed of the EMV in the corridor (``copy_sumo``)."""
    emv_gap_escape_mps: float = mps_from_kmh(20.0)
    """Speed of the EMV in a gap escape."""
    civilian_yield_lane_change_mps: float = mps_from_kmh(10.0)
    """Civilian, L2 lane change."""
    civilian_pull_over_mps: float = mps_from_kmh(15.0)
    """Speed of a civilian that pulls over at L3."""
    civilian_yield_speed_difference: float = 0.5
    """Share by which an L2 civilian stays below the speed limit."""


PAPER_CONSTANTS: Final = ControlConstants()
PAPER_SPEEDS: Final = TargetSpeeds()
