"""Scores of three-class answers: confusion matrices and the scores that follow from them, overall and by template.

Scores lie between 0 and 1 and have intervals. A score that would divide by nothing is not valid, and 0 as in the
paper.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Final

import numpy as np
import numpy.typing as npt

from siren_ros.evaluation.risk.answers import Answers
from siren_ros.evaluation.risk.labels import RiskClass
from siren_ros.evaluation.risk.video_set import VideoSet
from siren_ros.tables.interval import Interval, mean_of_intervals, share_interval

Confusion = npt.NDArray[np.int64]
"""Counts of videos, shape ``(3, 4)``: row the reference class, column the answer, the last one for no usable answer."""

NO_ANSWER: Final = len(RiskClass)
"""Column of the videos whose answer could not be read. They count as wrong, and as no answer of any class."""


def confusion(reference: Sequence[RiskClass], answers: Sequence[RiskClass | None]) -> Confusion:
    """Counts of each reference class and answer; None is an answer that could not be read."""
    counts = np.zeros((len(RiskClass), len(RiskClass) + 1), dtype=np.int64)
    columns = [NO_ANSWER if answer is None else answer for answer in answers]
    np.add.at(counts, (np.array(reference, dtype=np.intp), np.array(columns, dtype=np.intp)), 1)
    return counts


def accuracy(counts: Confusion) -> Interval:
    """Share of right answers."""
    return share_interval(int(np.trace(counts)), int(counts.sum()))


def precision(counts: Confusion, risk: RiskClass) -> Interval:
    """Share of the answers of a class that are right; not valid where the class was never answered."""
    return share_interval(int(counts[risk, risk]), int(counts[:, risk].sum()))


def recall(counts: Confusion, risk: RiskClass) -> Interval:
    """Share of the videos of a class that were recognised; not valid where there are none."""
    return share_interval(int(counts[risk, risk]), int(counts[risk].sum()))


def f1(counts: Confusion, risk: RiskClass) -> Interval:
    """Harmonic mean of precision and recall: 2·TP / (answers + videos) of the class.

    It rises with the share of right ones among the videos that are, or are said to be, of the class: 2·share /
    (1 + share). So do its bounds.
    """
    right = int(counts[risk, risk])
    share = share_interval(right, int(counts[:, risk].sum() + counts[risk].sum()) - right)
    value, low, high = (2.0 * part / (1.0 + part) for part in (share.value, share.low, share.high))
    return Interval(value, low, high, share.blocks)


def balanced_accuracy(counts: Confusion) -> Interval:
    """Mean recall of the classes that have videos."""
    return mean_of_intervals([recall(counts, risk) for risk in RiskClass], int(counts.sum()))


def macro_f1(counts: Confusion) -> Interval:
    """Mean F1 of the classes that have videos or answers."""
    return mean_of_intervals([f1(counts, risk) for risk in RiskClass], int(counts.sum()))


SCORES: Final[Mapping[str, Callable[[Confusion], Interval]]] = {
    "accuracy": accuracy,
    "balanced_accuracy": balanced_accuracy,
    "macro_f1": macro_f1,
    **{
        f"{name}_{risk.name.lower()}": partial(score, risk=risk)
        for name, score in (("precision", precision), ("recall", recall), ("f1", f1))
        for risk in RiskClass
    },
}
"""Every score by its name in tables and files."""


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
    answered = [(video, answers[key]) for key, video in sorted(videos.videos.items()) if key in answers]

    def counts(template: str | None = None) -> Confusion:
        of_template = [(video, answer) for video, answer in answered if template in (None, video.template)]
        return confusion([video.label.risk for video, _ in of_template], [answer for _, answer in of_template])

    templates = sorted({video.template for video, _ in answered})
    by_template = {template: counts(template) for template in templates}
    return ModelScores(name, len(videos.videos), len(answered), counts(), by_template)
