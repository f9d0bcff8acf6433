"""Checks whether recorded motion is physically possible: measured extremes and their limits."""

from dataclasses import dataclass
from typing import Final

import numpy as np

from siren_ros.base.numerics.arrays import Floats
from siren_ros.base.numerics.geometry import overlapping_pairs
from siren_ros.data.recording.episode_record import EpisodeRecord
from siren_ros.scoring.judging.verdict import Moment, Part, at_least, at_most, moments_of
from siren_ros.simulation.world.actors import ActorStates, Mode
from siren_ros.simulation.world.traffic_state import EventKind

LATERAL_PERCENTILE: Final = 99.9
EMV_PERCENTILES: Final = (1.0, 99.0)
CIVILIAN_PERCENTILES: Final = (0.5, 99.5)
MOVING_MPS: Final = 0.3
"""Slower vehicles count as standing; their deceleration is not braking."""
PAPER_PRESET: Final = "paper"
"""The preset in which every driver reacts."""


@dataclass(frozen=True)
class VerifyLimits:
    """Limits of the checks."""

    jump_m: float = 0.05
    """Largest change of position between two steps beyond ``v · dt``."""
    turn_rad: float = 0.01
    """Largest change of yaw between two steps beyond the limits of steering and grip."""
    steer_max_rad: float = 0.7
    """Largest road-wheel angle of any class (40°)."""
    wheelbase_share: float = 0.5
    """Smallest wheelbase of any class relative to its length: that of buses and fire engines."""
    walker_turn_radps: float = 4.5
    """Largest turn rate of a pedestrian: a turn on the spot within a step."""
    lateral_accel_mps2: float = 12.0
    """Largest lateral acceleration: dry tyres give 1 g, plus a margin for transients."""
    speed_error_mps: float = 0.5
    """Largest difference between the mean velocity of two steps and the change of position between them."""
    residual_p99_m: float = 0.5
    """Limit for the 99th percentile of an actor's residual (SUMO's pose against the simulated pose)."""
    residual_max_m: float = 2.0
    """Limit for the largest residual of an actor."""
    overlap_m: float = 0.3
    """Largest overlap of two footprints: real bodies deform by as much at walking speed."""
    impact_speed_mps: float = 2.0
    """Largest impact speed: the paper's drivers all react, so that vehicles touch only while they manoeuvre."""
    comfort_lateral_mps2: float = 4.0
    """Limit for the 99.9th percentile of all vehicles' lateral acceleration: the most that drivers use in urban bends
    (Hugemann and Nickel, "Longitudinal and lateral accelerations in normal day driving", ITAI 2003)."""
    emv_brake_mps2: float = 4.0
    """Limit for the 1st percentile of an EMV's braking: that of an anticipating driver (same source, urban roads)."""
    emv_accel_mps2: float = 2.5
    """Limit for the 99th percentile of an EMV's acceleration: a brisk start of a van (same source)."""
    civilian_brake_mps2: float = 4.0
    """Limit for the 0.5th percentile of moving civilians' braking: what drivers use in traffic (same source). Emergency
    braking may be harder, but is rare."""
    civilian_accel_mps2: float = 3.0
    """Limit for the 99.5th percentile of moving civilians' acceleration: a brisk start of a car (same source)."""
    civilian_lateral_mps2: float = 5.0
    """Largest lateral acceleration of a civilian at any time: half of what dry tyres give, more than drivers use on
    roads."""


@dataclass(frozen=True)
class PhysicsSummary:
    """Measured extremes over all actors and steps of an episode; zeros if there is nothing to measure."""

    contacts: int = 0
    impact_mps: float = 0.0
    """Largest impact speed."""
    overlap_m: float = 0.0
    """Largest penetration of two footprints."""
    overlap_moment: Moment | None = None
    """Step and actors of the largest overlap."""
    lateral_accel_mps2: float = 0.0
    """99.9th percentile of lateral acceleration over all vehicles."""
    emv_accel_low_mps2: float = 0.0
    """1st percentile of the longitudinal acceleration of all EMVs."""
    emv_accel_high_mps2: float = 0.0
    """99th percentile of the longitudinal acceleration of all EMVs."""
    civilian_accel_low_mps2: float = 0.0
    """0.5th percentile of the longitudinal acceleration of moving civilians."""
    civilian_accel_high_mps2: float = 0.0
    """99.5th percentile of the longitudinal acceleration of moving civilians."""
    civilian_lateral_mps2: float = 0.0
    """Largest lateral acceleration of moving civilians."""


def summarise_physics(record: EpisodeRecord) -> PhysicsSummary:
    """Measure contacts, overlap and accelerations of an episode."""
    rows = record.rows
    speeds = [float(event.detail["impact_speed_mps"]) for event in record.events_of(EventKind.COLLISION)]
    lateral = np.abs(rows.lateral_accel_mps2)
    is_emv = np.isin(rows.actor_id, np.array(record.emv_ids, dtype=np.uint32))
    low, high = _extremes(rows.accel_mps2[is_emv], EMV_PERCENTILES)
    overlaps = (deepest_overlap(state, record) for state in record.states)
    overlap_m, overlap_moment = max(overlaps, key=lambda overlap: overlap[0], default=(0.0, None))
    walks = np.isin(rows.actor_id, record.walker_ids)
    driven = ~is_emv & ~walks & (rows.speed_mps > MOVING_MPS) & (rows.mode != Mode.STOPPED)
    civilian_low, civilian_high = _extremes(rows.accel_mps2[driven], CIVILIAN_PERCENTILES)
    return PhysicsSummary(
        contacts=len(speeds),
        impact_mps=max(speeds, default=0.0),
        overlap_m=overlap_m,
        overlap_moment=overlap_moment,
        lateral_accel_mps2=float(np.percentile(lateral, LATERAL_PERCENTILE)) if len(lateral) else 0.0,
        emv_accel_low_mps2=low,
        emv_accel_high_mps2=high,
        civilian_accel_low_mps2=civilian_low,
        civilian_accel_high_mps2=civilian_high,
        civilian_lateral_mps2=float(lateral[driven].max(initial=0.0)),
    )


def _extremes(values: Floats, percentiles: tuple[float, float]) -> tuple[float, float]:
    low, high = np.percentile(values, percentiles) if len(values) else (0.0, 0.0)
    return float(low), float(high)


def deepest_overlap(state: ActorStates, record: EpisodeRecord) -> tuple[float, Moment | None]:
    """Largest penetration depth of two footprints at a step (separating axis theorem), 0 if none overlap, and whose.

    People who pass each other on foot do not count: they turn their shoulders.
    """
    sizes = np.array([(record.actors[int(i)].length_m, record.actors[int(i)].width_m) for i in state.actor_id])
    if len(sizes) < 2:
        return 0.0, None
    length, width = sizes.T
    first, second, depth_m = overlapping_pairs(state.x_m, state.y_m, state.yaw_rad, length, width)
    walks = np.isin(state.actor_id, record.walker_ids)
    counts = ~(walks[first] & walks[second])
    if not counts.any():
        return 0.0, None
    deepest = int(np.argmax(np.where(counts, depth_m, -np.inf)))
    return float(depth_m[deepest]), Moment(state.step, int(state.actor_id[first[deepest]]))


def check_physics(record: EpisodeRecord, limits: VerifyLimits) -> tuple[Part, ...]:
    """Compare the summary with its limits; drawn drivers may crash at any speed."""
    summary = summarise_physics(record)
    impact_mps = limits.impact_speed_mps if record.description.preset == PAPER_PRESET else np.inf
    contacts = record.events_of(EventKind.COLLISION)
    hardest = sorted(contacts, key=lambda event: float(event.detail["impact_speed_mps"]))[-1:]
    return (
        at_most("overlap_m", summary.overlap_m, limits.overlap_m, "", *filter(None, [summary.overlap_moment])),
        at_most(
            "impact_speed_mps", summary.impact_mps, impact_mps, f"{summary.contacts} contacts", *moments_of(hardest)
        ),
        at_most("lateral_accel_p99_9_mps2", summary.lateral_accel_mps2, limits.comfort_lateral_mps2),
        at_least("emv_accel_p1_mps2", summary.emv_accel_low_mps2, -limits.emv_brake_mps2),
        at_most("emv_accel_p99_mps2", summary.emv_accel_high_mps2, limits.emv_accel_mps2),
        at_least("civilian_accel_p0_5_mps2", summary.civilian_accel_low_mps2, -limits.civilian_brake_mps2),
        at_most("civilian_accel_p99_5_mps2", summary.civilian_accel_high_mps2, limits.civilian_accel_mps2),
        at_most("civilian_lateral_mps2", summary.civilian_lateral_mps2, limits.civilian_lateral_mps2),
    )
