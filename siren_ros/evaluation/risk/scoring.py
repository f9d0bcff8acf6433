"""All scores of one model's answers to a set of videos, overall and by template, with intervals."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from siren_ros.evaluation.risk.answers import Answers
from siren_ros.evaluation.risk.risk_class import RiskClass
from siren_ros.evaluation.risk.scores import SCORES, Confusion, Score, confusion
from siren_ros.evaluation.risk.video_set import VideoSet
from siren_ros.evaluation.statistics.block_bootstrap import interval_of
from siren_ros.evaluation.statistics.interval import Interval
from siren_ros.numerics.arrays import Rows
from siren_ros.numerics.random_streams import random_stream

_RESAMPLES: Final = 1000


@dataclass(frozen=True)
class ModelScores:
    """A model's scores on a set."""

    name: str
    videos: int
    """Of the set."""
    answered: int
    """Videos that have an answer; the others do not count."""
    overall: Confusion
    by_template: Mapping[str, Confusion]
    intervals: Mapping[str, Interval]
    """Of each score of the table SCORES, by bootstrap over videos within their templates."""

    @property
    def scores(self) -> Mapping[str, Score]:
        """Every score overall, by name."""
        return {name: score(self.overall) for name, score in SCORES.items()}


def score_answers(name: str, videos: VideoSet, answers: Answers) -> ModelScores:
    """Scores a model's answers; ``answers`` holds ids of the set only."""
    ids = [key for key in sorted(videos.videos) if key in answers]
    reference = [videos.videos[key].label.risk for key in ids]
    given = [answers[key] for key in ids]
    templates = [videos.videos[key].template for key in ids]
    by_template = {
        template: confusion(*_of(template, templates, reference, given)) for template in sorted(set(templates))
    }
    counts = confusion(reference, given)
    return ModelScores(name, len(videos.videos), len(ids), counts, by_template, _intervals(reference, given, templates))


def _of(
    template: str, templates: Sequence[str], reference: Sequence[RiskClass], given: Sequence[RiskClass | None]
) -> tuple[list[RiskClass], list[RiskClass | None]]:
    rows = [row for row, one in enumerate(templates) if one == template]
    return [reference[row] for row in rows], [given[row] for row in rows]


def _intervals(
    reference: Sequence[RiskClass], given: Sequence[RiskClass | None], templates: Sequence[str]
) -> dict[str, Interval]:
    """Every score with its interval; the same resamples for all of them."""
    _, stratum = np.unique(np.array(templates, dtype=np.str_), return_inverse=True)

    def statistic(score: Callable[[Confusion], Score]) -> Callable[[Rows], float]:
        return lambda rows: score(confusion([reference[row] for row in rows], [given[row] for row in rows])).value

    return {
        name: interval_of(statistic(score), stratum, random_stream(0, "evaluation/risk"), _RESAMPLES)
        for name, score in SCORES.items()
    }
