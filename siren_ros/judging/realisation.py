"""What tells a template's realisations apart: the EMV's arrival and speed, the queue that it meets, who yields."""

from dataclasses import dataclass
from typing import Final

import numpy as np

from siren_ros.numerics.units import STEP_S, steps_from_s
from siren_ros.recording.episode_record import EpisodeRecord
from siren_ros.roads.sites.site_middle import middle_of_site
from siren_ros.world.events import EventKind

STANDING_MPS: Final = 1.0
NEAR_M: Final = 30.0
"""An EMV that comes no nearer to the conflict point does not arrive."""
QUEUE_RANGE_M: Final = 50.0
"""Radius around the EMV within which standing vehicles are its queue (paper: the interaction region's outer radius)."""
BEFORE_ARRIVAL_S: Final = 3.0
"""The queue is counted this long before the EMV arrives, when it is still ahead."""


@dataclass(frozen=True)
class Realisation:
    """Figures of one episode that differ from seed to seed."""

    arrival_s: float
    """Time at which the EMV is nearest to the site's conflict point; NaN where it never comes within 30 m."""
    queue: int
    """Civilians that stand around the EMV before it arrives."""
    yielding: int
    """Civilians that begin to yield."""
    emv_speed_mps: float
    """Mean over the episode."""


def realisation_of(record: EpisodeRecord) -> Realisation:
    """The realisation of a record; the conflict point is the site's junction, or else the middle of its road."""
    track = record.track(record.emv_ids[0])
    conflict = middle_of_site(record.network, record.description.site)
    distance = np.hypot(*(track.xy_m - conflict).T) if conflict is not None else np.full(len(track), np.inf)
    nearest = int(np.argmin(distance))
    arrives = bool(distance[nearest] < NEAR_M)
    counted = max(nearest - steps_from_s(BEFORE_ARRIVAL_S), 0)
    states = record.states[int(track.step[counted]) - record.states[0].step]
    near = np.hypot(states.x_m - track.x_m[counted], states.y_m - track.y_m[counted]) < QUEUE_RANGE_M
    civilian = ~np.isin(states.actor_id, record.emv_ids)
    return Realisation(
        arrival_s=float(track.step[nearest]) * STEP_S if arrives else float("nan"),
        queue=int(np.count_nonzero(near & civilian & (states.speed_mps < STANDING_MPS))),
        yielding=len({event.actor_id for event in record.events_of(EventKind.YIELD_STARTED)}),
        emv_speed_mps=float(track.speed_mps.mean()),
    )
