"""Structures of the lockstep's protocol: what participants and master tell each other."""

from dataclasses import dataclass
from enum import IntEnum

from siren_ros.scenario.episode import EpisodeEnd


class Phase(IntEnum):
    """Which part of the protocol a report belongs to."""

    READY = 0
    STEP = 1
    FINAL = 2


@dataclass(frozen=True)
class StepReport:
    """One participant's StepDone."""

    step: int
    participant: str
    phase: Phase
    error: str = ""
    busy_s: float = 0.0
    """Wall time the participant spent on the step, for the closing summary only."""


@dataclass(frozen=True)
class EpisodeClosing:
    """The master's message that the episode is over."""

    steps: int
    end: EpisodeEnd
    reason: str
