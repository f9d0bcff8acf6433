"""All scores as JSON types."""

from collections.abc import Mapping, Sequence
from typing import Any

from siren_ros.evaluation.detection.metrics.devkit_score import DevkitScore
from siren_ros.evaluation.detection.scoring import DetectorScores
from siren_ros.evaluation.statistics.interval import Interval


def scores_as_json(scores: Sequence[DetectorScores]) -> dict[str, Any]:
    """By the detectors' names; intervals are null where there are too few episodes."""
    return {one.name: _detector(one) for one in scores}


def _detector(one: DetectorScores) -> dict[str, Any]:
    return {
        "format": one.format,
        "velocity_known": one.has_velocity,
        "mean": {"mAP": _interval(one.mean_ap), "NDS": one.mean_nds},
        "templates": {
            name: {"frames": one.frames[name], **_score(score), "mAP": _interval(one.template_ap[name])}
            for name, score in one.templates.items()
        },
        "families": {name: _interval(value) for name, value in one.families.items()},
        "order_of_families_share": None if one.order is None else one.order.whole,
        "order_of_families_steps": None if one.order is None else dict(one.order.steps),
        "parts": [
            {"of": part.group, "name": part.name, "labels": part.labels, "mAP": _interval(part.mean_ap)}
            for part in one.groups
        ],
    }


def _score(score: DevkitScore) -> Mapping[str, Any]:
    return {
        "labels": score.labels,
        "detections": score.detections,
        "NDS": score.nds,
        "AP": {f"{distance_m:g}": value for distance_m, value in score.average_precision.items()},
        "errors": dict(score.errors),
        "precision_at_recall_0_to_1": score.precision.round(6).tolist(),
    }


def _interval(value: Interval) -> dict[str, Any] | None:
    if not value.valid:
        return None
    bounds = (value.low, value.high) if value.bounded else (None, None)
    return {"value": value.value, "low": bounds[0], "high": bounds[1], "episodes": value.blocks}
