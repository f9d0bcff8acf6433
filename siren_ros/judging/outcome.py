"""The outcome of an episode: whether the interaction happened, and its numbers."""

from typing import Any

import numpy as np

from siren_ros.errors import SirenError
from siren_ros.interfaces.lockstep_reports import EpisodeClosing
from siren_ros.judging.av_response import av_response
from siren_ros.judging.predicates import evaluate_predicate
from siren_ros.judging.residuals import summarise_residuals
from siren_ros.recording.episode_record import EpisodeRecord
from siren_ros.recording.record_builder import RecordBuilder
from siren_ros.scenario.episode import EpisodeOutcome
from siren_ros.world.events import EventKind


def judge(builder: RecordBuilder, closing: EpisodeClosing) -> EpisodeOutcome:
    """The outcome of an episode that has just ended; ``predicate_holds`` is None where it cannot be judged."""
    try:
        return outcome_of(builder.build(), closing)
    except SirenError as error:
        return EpisodeOutcome(closing.end, closing.reason, closing.steps, None, {"predicate": str(error)})


def outcome_of(record: EpisodeRecord, closing: EpisodeClosing) -> EpisodeOutcome:
    """The outcome of a record; raises as ``evaluate_predicate`` does."""
    verdict = evaluate_predicate(record)
    measures: dict[str, float | int | str] = {"predicate": verdict.text}
    measures.update({f"predicate.{part.name}": part.value for part in verdict.parts})
    measures.update(_interaction_measures(record))
    response = av_response(record)
    if response is not None:
        measures.update(response.measures())
    return EpisodeOutcome(closing.end, closing.reason, closing.steps, verdict.holds, measures)


def _interaction_measures(record: EpisodeRecord) -> dict[str, Any]:
    residual = summarise_residuals(record)
    emv = record.track(record.emv_ids[0]) if record.emv_ids else None
    measures: dict[str, Any] = {
        "actors": len(record.actors),
        "collisions": len(record.events_of(EventKind.COLLISION)),
        "yields_started": len(record.events_of(EventKind.YIELD_STARTED)),
        "yields_completed": len(record.events_of(EventKind.YIELD_COMPLETED)),
        "yields_deferred": len(record.events_of(EventKind.YIELD_DEFERRED)),
        "residual_p99_m": residual.p99_m,
        "residual_max_m": residual.max_m,
    }
    if emv is not None and len(emv):
        measures["emv_distance_m"] = float(np.sum(np.hypot(np.diff(emv.x_m), np.diff(emv.y_m))))
        measures["emv_mean_speed_mps"] = float(np.mean(emv.speed_mps))
    return measures
