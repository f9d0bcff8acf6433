"""The physics of an episode: contacts, overlap, and accelerations that a traffic engineer would look at."""

from dataclasses import dataclass
from typing import Final

import numpy as np

from siren_ros.numerics.geometry import overlapping_pairs
from siren_ros.recording.episode_record import EpisodeRecord
from siren_ros.world.actors import ActorStates
from siren_ros.world.events import EventKind

LATERAL_PERCENTILE: Final = 99.9
EMV_PERCENTILES: Final = (1.0, 99.0)


@dataclass(frozen=True)
class PhysicsSummary:
    """Over all actors and steps of an episode; zeros where there is nothing to measure."""

    contacts: int = 0
    impact_mps: float = 0.0
    """Greatest impact speed."""
    overlap_m: float = 0.0
    """Greatest penetration of two footprints."""
    lateral_accel_mps2: float = 0.0
    """99.9th percentile of everybody's."""
    emv_accel_low_mps2: float = 0.0
    """1st percentile of the longitudinal acceleration of all EMVs."""
    emv_accel_high_mps2: float = 0.0
    """99th percentile of the same."""


def summarise_physics(record: EpisodeRecord) -> PhysicsSummary:
    """Contacts, overlap and accelerations of an episode."""
    low, high = emv_accel_range_mps2(record)
    speeds = impact_speeds_mps(record)
    return PhysicsSummary(
        contacts=len(speeds),
        impact_mps=max(speeds, default=0.0),
        overlap_m=largest_overlap_m(record),
        lateral_accel_mps2=lateral_accel_mps2(record),
        emv_accel_low_mps2=low,
        emv_accel_high_mps2=high,
    )


def impact_speeds_mps(record: EpisodeRecord) -> tuple[float, ...]:
    """Impact speed of each contact."""
    return tuple(float(event.detail["impact_speed_mps"]) for event in record.events_of(EventKind.COLLISION))


def lateral_accel_mps2(record: EpisodeRecord) -> float:
    """99.9th percentile of everybody's lateral acceleration."""
    lateral = np.abs(record.rows.lateral_accel_mps2)
    return float(np.percentile(lateral, LATERAL_PERCENTILE)) if len(lateral) else 0.0


def emv_accel_range_mps2(record: EpisodeRecord) -> tuple[float, float]:
    """1st and 99th percentile of the longitudinal acceleration of all EMVs."""
    rows = record.rows
    accel = rows.accel_mps2[np.isin(rows.actor_id, np.array(record.emv_ids, dtype=np.uint32))]
    low, high = np.percentile(accel, EMV_PERCENTILES) if len(accel) else (0.0, 0.0)
    return float(low), float(high)


def largest_overlap_m(record: EpisodeRecord) -> float:
    """Greatest penetration of two footprints at any step."""
    return max((overlap_m(state, record) for state in record.states), default=0.0)


def overlap_m(state: ActorStates, record: EpisodeRecord) -> float:
    """Greatest penetration depth of two footprints at a step, 0 where none overlap (separating axis theorem)."""
    sizes = np.array([(record.actors[int(i)].length_m, record.actors[int(i)].width_m) for i in state.actor_id])
    if len(sizes) < 2:
        return 0.0
    length, width = sizes.T
    _, _, depth_m = overlapping_pairs(state.x_m, state.y_m, state.yaw_rad, length, width)
    return float(depth_m.max(initial=0.0))
