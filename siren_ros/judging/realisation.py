"""What tells a template's realisations apart: the EMV's arrival and speed, the queue that it meets, who yields."""

from dataclasses import dataclass
from typing import Final

import numpy as np
import shapely

from siren_ros.numerics.units import STEP_S, steps_from_s
from siren_ros.recording.episode_record import EpisodeRecord
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
    distance = np.hypot(*(track.xy_m - _conflict_point(record)).T)
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


def _conflict_point(record: EpisodeRecord) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """Shape ``(2,)``, ``map`` frame."""
    site, network = record.description.site, record.network
    junction = network.junctions.get(str(site.get("junction", "")))
    if junction is not None:
        if len(junction.outline) > 2:
            return np.asarray(shapely.Polygon(junction.outline).buffer(0).centroid.coords[0])
        return np.array([junction.x_m, junction.y_m])
    stretch = site.get("stretch")
    names = [str(name) for name in stretch] if isinstance(stretch, list | tuple) else []
    lanes = [network.lanes[network.edge_by_id[name].lanes[-1]] for name in names if name in network.edge_by_id]
    if not lanes:
        return record.track(record.emv_ids[0]).xy_m[-1]
    middle = lanes[len(lanes) // 2]
    return np.asarray(middle.centre.at(0.5 * middle.length_m))
