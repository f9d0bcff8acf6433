"""The measures of a video over its time: what the page draws."""

from dataclasses import dataclass
from typing import Final

import numpy as np

from siren_ros.evaluation.risk.labels import RiskThresholds
from siren_ros.evaluation.risk.video_set import RiskVideo
from siren_ros.numerics.arrays import Floats
from siren_ros.numerics.units import STEP_S

FRAME_S: Final = 0.1
"""From one frame of a video to the next."""


@dataclass(frozen=True)
class Dot:
    """One event: a time in the video and a value."""

    at_s: float
    value: float
    actor_id: int


@dataclass(frozen=True)
class Curves:
    """Measures at each step of a video's window; NaN where nobody is on a collision course."""

    time_s: Floats
    """Shape ``(N,)``, from 0 at the first frame."""
    time_to_collision_s: Floats
    """Least of all civilians that count, shape ``(N,)``."""
    required_deceleration_mps2: Floats
    """Greatest of those that are near enough to count, shape ``(N,)``."""
    encroachments: tuple[Dot, ...]
    """PET of each civilian whose place the EMV came through, or the other way round."""
    contacts: tuple[Dot, ...]
    """Impact speeds in m/s."""
    moment_s: float | None
    """When that happened which decided the label."""


def curves_of(video: RiskVideo, thresholds: RiskThresholds) -> Curves:
    """The curves of a video.

    Args:
        video: The video with its evidence.
        thresholds: Of the labels: slower closing and farther vehicles do not count, and are left out.
    """
    count = round(video.frames * FRAME_S / STEP_S)
    moments, first = video.evidence.moments, video.first_step
    inside = (moments.step >= first) & (moments.step < first + count)
    closing = inside & (moments.closing_mps > thresholds.closing_mps)
    near = inside & (moments.gap_m < thresholds.gap_m)
    least, most = np.full(count, np.nan), np.full(count, np.nan)
    np.fmin.at(least, moments.step[closing] - first, moments.time_to_collision_s[closing])
    np.fmax.at(most, moments.step[near] - first, moments.required_deceleration_mps2[near])

    def second(step: int) -> float:
        return (step - first) * STEP_S

    return Curves(
        np.arange(count) * STEP_S,
        least,
        most,
        tuple(Dot(second(one.step), one.time_s, one.actor_id) for one in video.evidence.encroachments),
        tuple(Dot(second(one.step), one.impact_mps, one.actor_id) for one in video.evidence.contacts),
        second(video.label.step) if video.label.actor_id else None,
    )
