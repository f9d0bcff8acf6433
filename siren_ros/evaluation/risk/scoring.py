"""All scores of one model's answers to a set of videos, overall and by template, with intervals."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from siren_ros.evaluation.risk.answers import Answers
from siren_ros.evaluation.risk.risk_class import RiskClass
from siren_ros.evaluation.risk.scores import SCORES, Confusion, confusion
from siren_ros.evaluation.risk.video_set import VideoSet
from siren_ros.evaluation.statistics.interval import Interval


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

    @property
    def scores(self) -> Mapping[str, Interval]:
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
    return ModelScores(name, len(videos.videos), len(ids), confusion(reference, given), by_template)


def _of(
    template: str, templates: Sequence[str], reference: Sequence[RiskClass], given: Sequence[RiskClass | None]
) -> tuple[list[RiskClass], list[RiskClass | None]]:
    rows = [row for row, one in enumerate(templates) if one == template]
    return [reference[row] for row in rows], [given[row] for row in rows]
