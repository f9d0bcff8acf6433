"""The response of the AV under test to the emergency vehicle, from the record alone."""

from dataclasses import dataclass

import numpy as np

from siren_ros.judging.relative_motion import ahead_and_left_m, common_rows
from siren_ros.numerics.units import STEP_S
from siren_ros.recording.episode_record import EpisodeRecord
from siren_ros.world.actors import NO_ACTOR
from siren_ros.world.events import EventKind

HEARD_M = 40.0
"""Largest distance between the two centres at which the AV hears the siren (paper: response distance)."""


@dataclass(frozen=True)
class AvResponse:
    """Numbers of one encounter."""

    heard_s: float
    """Simulated time at which the EMV came within ``HEARD_M`` from behind; −1 where it never did."""
    passed_after_s: float
    """Time from ``heard_s`` until the EMV's centre was ahead of the AV's; −1 where it did not pass."""
    speed_drop_mps: float
    """Speed at ``heard_s`` minus the lowest speed until the EMV had passed."""
    moved_right_m: float
    """Largest displacement to the right of the AV's line of travel at ``heard_s``."""
    closest_m: float
    """Least distance between the two centres."""
    collisions: int
    """Collisions of the AV with any vehicle."""

    def measures(self) -> dict[str, float | int | str]:
        """The numbers as an episode's outcome stores them."""
        return {f"av.{name}": value for name, value in vars(self).items()}


def av_response(record: EpisodeRecord) -> AvResponse | None:
    """The response of the AV under test; None in episodes without one."""
    av_id = record.description.av_id
    if av_id == NO_ACTOR or not record.emv_ids:
        return None
    av, emv = common_rows(record.track(av_id), record.track(record.emv_ids[0]))
    collisions = sum(av_id in {event.actor_id, event.other_id} for event in record.events_of(EventKind.COLLISION))
    if not len(av):
        return AvResponse(-1.0, -1.0, 0.0, 0.0, 0.0, collisions)
    away = emv.xy_m - av.xy_m
    distance = np.hypot(away[:, 0], away[:, 1])
    ahead = ahead_and_left_m(av, emv)[0] > 0.0
    within = np.flatnonzero((distance <= HEARD_M) & ~ahead)
    if not len(within):
        return AvResponse(-1.0, -1.0, 0.0, 0.0, float(distance.min()), collisions)
    first = int(within[0])
    passed = first + int(np.argmax(ahead[first:])) if ahead[first:].any() else -1
    until = slice(first, passed + 1 if passed >= 0 else None)
    yaw = float(av.yaw_rad[first])
    line = av.xy_m[until] - av.xy_m[first]
    right = line[:, 0] * np.sin(yaw) - line[:, 1] * np.cos(yaw)
    return AvResponse(
        heard_s=float(av.time_s[first]),
        passed_after_s=(passed - first) * STEP_S if passed >= 0 else -1.0,
        speed_drop_mps=float(av.speed_mps[first] - av.speed_mps[until].min()),
        moved_right_m=float(right.max()),
        closest_m=float(distance.min()),
        collisions=collisions,
    )
