"""The outcome of an episode: verdict of the predicate, residuals, the AV's response, and figures of the episode."""

from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from siren_ros.base.numerics.units import STEP_S, steps_from_s
from siren_ros.data.interfaces.episode_conversions import EpisodeClosing
from siren_ros.data.record.vehicle_location import ahead_and_left_m, common_rows
from siren_ros.data.recording.episode_record import EpisodeRecord
from siren_ros.data.recording.record_builder import RecordBuilder
from siren_ros.errors import SirenError
from siren_ros.scoring.judging.people import people_measures
from siren_ros.scoring.judging.predicates import evaluate_predicate, verdicts_of_others
from siren_ros.simulation.roads.sites import middle_of_site
from siren_ros.simulation.scenario.episode import EpisodeOutcome
from siren_ros.simulation.world.actors import NO_ACTOR, Owner
from siren_ros.simulation.world.traffic_state import EventKind

HEARD_M: Final = 40.0
"""The AV hears the siren within this distance between the centres (paper: response distance)."""
STANDING_MPS: Final = 1.0
NEAR_M: Final = 30.0
"""An EMV that never comes nearer than this to the conflict point does not arrive."""
QUEUE_RANGE_M: Final = 50.0
"""Standing vehicles within this radius of the EMV are its queue (paper: outer radius of the interaction region)."""
BEFORE_ARRIVAL_S: Final = 3.0
"""The queue is counted this long before the EMV arrives, when it is still ahead."""


@dataclass(frozen=True)
class ResidualSummary:
    """Statistics of the residuals over all actors and steps; zeros if SUMO owns no actor."""

    median_m: float
    p99_m: float
    max_m: float


def summarise_residuals(record: EpisodeRecord) -> ResidualSummary:
    """Median, 99th percentile and largest value of an episode's residuals."""
    rows = record.rows
    residual_m = rows.residual_m[rows.owner == Owner.SUMO]
    if not len(residual_m):
        return ResidualSummary(0.0, 0.0, 0.0)
    median_m, p99_m = np.percentile(residual_m, (50, 99))
    return ResidualSummary(float(median_m), float(p99_m), float(residual_m.max()))


@dataclass(frozen=True)
class AvResponse:
    """How the AV under test responds to the EMV."""

    heard_s: float = -1.0
    """Simulated time at which the EMV came within ``HEARD_M`` from behind; −1 if it never did."""
    passed_after_s: float = -1.0
    """Time from ``heard_s`` until the EMV's centre was ahead of the AV's; −1 if it did not pass."""
    speed_drop_mps: float = 0.0
    """Speed at ``heard_s`` minus the lowest speed until the EMV had passed."""
    moved_right_m: float = 0.0
    """Largest displacement to the right of the AV's line of travel at ``heard_s``; to the left in left-hand traffic."""
    closest_m: float = 0.0
    """Smallest distance between the two centres."""
    collisions: int = 0
    """Number of collisions of the AV with any vehicle."""

    def measures(self) -> dict[str, float | int | str]:
        """The values as an episode's outcome stores them."""
        return {f"av.{name}": value for name, value in vars(self).items()}


def av_response(record: EpisodeRecord) -> AvResponse | None:
    """Response of the AV under test to the first EMV, which comes from behind; None in episodes without an AV."""
    av_id = record.description.av_id
    if av_id == NO_ACTOR or not record.emv_ids:
        return None
    record = record.right_hand
    av, emv = common_rows(record.track(av_id), record.track(record.emv_ids[0]))
    collisions = sum(av_id in {event.actor_id, event.other_id} for event in record.events_of(EventKind.COLLISION))
    if not len(av):
        return AvResponse(collisions=collisions)
    away = emv.xy_m - av.xy_m
    distance = np.hypot(away[:, 0], away[:, 1])
    ahead = ahead_and_left_m(av, emv)[0] > 0.0
    within = np.flatnonzero((distance <= HEARD_M) & ~ahead)
    if not len(within):
        return AvResponse(closest_m=float(distance.min()), collisions=collisions)
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


@dataclass(frozen=True)
class Realisation:
    """Figures of one episode that differ between seeds; the EMV is the first one."""

    arrival_s: float
    """Time at which the EMV is nearest to the site's conflict point; NaN if it never comes within 30 m."""
    queue: int
    """Number of civilians that stand around the EMV before it arrives."""
    yielding: int
    """Number of civilians that begin to yield."""
    emv_speed_mps: float
    """Mean speed of the EMV over the episode."""


def realisation_of(record: EpisodeRecord) -> Realisation:
    """Compute these figures; the conflict point is the site's junction, or the middle of its road."""
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


def _drive_of(record: EpisodeRecord, emv_id: int) -> dict[str, float]:
    """Distance and mean speed of an EMV; empty if it was never present."""
    emv = record.track(emv_id)
    if not len(emv):
        return {}
    distance_m = float(np.sum(np.hypot(np.diff(emv.x_m), np.diff(emv.y_m))))
    return {"distance_m": distance_m, "mean_speed_mps": float(np.mean(emv.speed_mps))}


def judge(builder: RecordBuilder, closing: EpisodeClosing) -> EpisodeOutcome:
    """Judge an episode that has just ended; ``predicate_holds`` is None if it cannot be judged."""
    try:
        return outcome_of(builder.build(), closing)
    except SirenError as error:
        return EpisodeOutcome(closing.end, closing.reason, closing.steps, None, {"predicate": str(error)})


def outcome_of(record: EpisodeRecord, closing: EpisodeClosing) -> EpisodeOutcome:
    """The outcome of a record; raises as ``evaluate_predicate``."""
    verdict = evaluate_predicate(record)
    residual = summarise_residuals(record)
    measures: dict[str, Any] = {
        "predicate": verdict.text,
        **{f"predicate.{name}": value for name, value in verdict.measures().items()},
        "actors": len(record.actors),
        "collisions": len(record.events_of(EventKind.COLLISION)),
        "yields_started": len(record.events_of(EventKind.YIELD_STARTED)),
        "yields_completed": len(record.events_of(EventKind.YIELD_COMPLETED)),
        "yields_deferred": len(record.events_of(EventKind.YIELD_DEFERRED)),
        "residual_p99_m": residual.p99_m,
        "residual_max_m": residual.max_m,
    }
    for emv_id in record.emv_ids[:1]:
        measures |= {f"emv_{name}": value for name, value in _drive_of(record, emv_id).items()}
    for emv_id, other in verdicts_of_others(record).items():
        told = {"predicate": other.text, "predicate_holds": int(other.holds), **_drive_of(record, emv_id)}
        measures |= {f"emv{emv_id}.{name}": value for name, value in told.items()}
    if (response := av_response(record)) is not None:
        measures.update(response.measures())
    measures |= people_measures(record)
    return EpisodeOutcome(closing.end, closing.reason, closing.steps, verdict.holds, measures)
