"""Checks that an episode's physics is one that a traffic engineer believes."""

from typing import Final

import numpy as np

from siren_ros.judging.verdict import Part, at_least, at_most
from siren_ros.judging.verification.limits import VerifyLimits
from siren_ros.judging.verification.physics import (
    emv_accel_range_mps2,
    impact_speeds_mps,
    largest_overlap_m,
    lateral_accel_mps2,
)
from siren_ros.recording.episode_record import EpisodeRecord

PAPER_PRESET: Final = "paper"
"""The preset in which every driver reacts."""


def check_overlap(record: EpisodeRecord, limits: VerifyLimits) -> Part:
    """No two bodies pass through each other."""
    return at_most("overlap_m", largest_overlap_m(record), limits.overlap_m)


def check_impact_speed(record: EpisodeRecord, limits: VerifyLimits) -> Part:
    """With the paper's drivers nobody is hit at speed; drawn drivers may crash."""
    speeds = impact_speeds_mps(record)
    limit = limits.impact_speed_mps if record.description.preset == PAPER_PRESET else np.inf
    return at_most("impact_speed_mps", max(speeds, default=0.0), limit, f"{len(speeds)} contacts")


def check_lateral_accel(record: EpisodeRecord, limits: VerifyLimits) -> Part:
    """Everybody takes bends and changes lanes as drivers do."""
    return at_most("lateral_accel_p99_9_mps2", lateral_accel_mps2(record), limits.comfort_lateral_mps2)


def check_emv_braking(record: EpisodeRecord, limits: VerifyLimits) -> Part:
    """The EMV anticipates instead of arriving and braking."""
    return at_least("emv_accel_p1_mps2", emv_accel_range_mps2(record)[0], -limits.emv_brake_mps2)


def check_emv_accel(record: EpisodeRecord, limits: VerifyLimits) -> Part:
    """The EMV accelerates as its engine and its crew do."""
    return at_most("emv_accel_p99_mps2", emv_accel_range_mps2(record)[1], limits.emv_accel_mps2)
