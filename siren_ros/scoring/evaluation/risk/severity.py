"""Severity of a video as two numbers (smallest TTC, contact speed), and how well answers estimate them."""

import csv
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from siren_ros.base.numerics.arrays import Floats
from siren_ros.base.params import plain_json
from siren_ros.base.tables.interval import Interval
from siren_ros.errors import InputError
from siren_ros.scoring.evaluation.risk.labels import Evidence, RiskThresholds
from siren_ros.scoring.evaluation.risk.video_set import VideoSet
from siren_ros.scoring.evaluation.statistics import BlockSums, interval_of_mean, rank_correlation
from siren_ros.scoring.judging.surrogate_safety import HORIZON_S


@dataclass(frozen=True)
class Severity:
    """Severity of one video."""

    least_ttc_s: float
    """Smallest TTC with vehicles that close faster than the labels' limit; ``HORIZON_S`` without one, 0 with a
    contact."""
    contact_mps: float
    """Speed of the hardest contact; 0 without a contact."""


MEASURES: Final = {"least_ttc_s": "least TTC in s", "contact_mps": "speed of the contact in m/s"}
Severities = Mapping[str, Severity]
"""Severities by video."""


def severity_of(evidence: Evidence, thresholds: RiskThresholds) -> Severity:
    """Severity of a video from its recorded evidence."""
    closing = evidence.moments.closing_mps > thresholds.closing_mps
    least = float(evidence.moments.time_to_collision_s[closing].min(initial=HORIZON_S))
    contact = max((hit.impact_mps for hit in evidence.contacts), default=0.0)
    return Severity(0.0 if evidence.contacts else least, contact)


def severities_of(videos: VideoSet) -> Severities:
    """The true severities of a set."""
    return {key: severity_of(video.evidence, videos.thresholds) for key, video in videos.videos.items()}


def template_means(videos: VideoSet) -> Severities:
    """Means of each template: the best estimate from the template alone."""
    truth = severities_of(videos)
    means = {}
    for template in {video.template for video in videos.videos.values()}:
        members = [truth[key] for key, video in videos.videos.items() if video.template == template]
        means[template] = Severity(*(float(np.mean([getattr(item, name) for item in members])) for name in MEASURES))
    return {key: means[video.template] for key, video in videos.videos.items()}


def read_severities(path: Path) -> Severities:
    """Read estimates of both numbers: JSON ``{"S1_000": {"least_ttc_s": 1.2, "contact_mps": 0.0}}``, or CSV.

    Empty where the file has none, as a file of classes alone.

    Raises:
        InputError: The file cannot be read, or a number is missing or not finite.
    """
    try:
        text = path.read_text(encoding="utf-8")
        if path.suffix.lower() == ".csv":
            rows = csv.DictReader(text.splitlines())
            given: Any = {row["video"]: row for row in rows} if set(MEASURES) <= set(rows.fieldnames or ()) else {}
        else:
            given = {key: value for key, value in plain_json.load(text).items() if isinstance(value, dict)}
        found = {key: Severity(*(float(value[name]) for name in MEASURES)) for key, value in given.items()}
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise InputError(
            "predictions", str(path), f"numbers {' and '.join(MEASURES)} of each video ({error})"
        ) from error
    for key, value in found.items():
        if not np.isfinite([value.least_ttc_s, value.contact_mps]).all():
            raise InputError("predictions", f"{path}: {key}", "finite numbers")
    return found


@dataclass(frozen=True)
class SeverityScore:
    """Quality of the estimates of one number."""

    error: Interval
    """Mean absolute error, with the interval over videos."""
    rank_correlation: float | None
    """Spearman's ρ with the truth; None if all estimates are equal."""


def score_severities(videos: VideoSet, given: Severities) -> Mapping[str, SeverityScore]:
    """Score estimates by measure.

    Videos without an estimate do not count; contact speed counts only videos with a contact.
    """
    truth = severities_of(videos)
    keys = sorted(set(truth) & set(given))
    scores = {}
    for name in MEASURES:
        counted = [key for key in keys if name != "contact_mps" or truth[key].contact_mps > 0.0]
        want, have = (np.array([getattr(of[key], name) for key in counted], dtype=float) for of in (truth, given))
        ranked = rank_correlation(want.tolist(), have.tolist())
        scores[name] = SeverityScore(_mean_error(np.abs(want - have)), None if ranked is None else ranked.rho)
    return scores


def _mean_error(errors: Floats) -> Interval:
    return interval_of_mean(BlockSums(errors, np.ones(len(errors)), np.zeros(len(errors), dtype=np.intp)))
