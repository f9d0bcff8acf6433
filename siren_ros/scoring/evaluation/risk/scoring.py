"""Scores answers to a set of videos, from files of any program or from references.

Scores come from confusion matrices, overall and by template, lie between 0 and 1 and have intervals. A score that would
divide by nothing is not valid, and 0 as in the paper. The severity of a video is two numbers (smallest TTC, contact
speed); it is scored how well answers estimate them.
"""

import csv
from collections import Counter
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from siren_ros.base.numerics.arrays import Floats
from siren_ros.base.params import plain_files
from siren_ros.base.tables import Interval, mean_of_intervals, share_interval
from siren_ros.errors import InputError
from siren_ros.scoring.evaluation.risk.labels import Evidence, RiskClass, RiskThresholds, label_of, risk_class
from siren_ros.scoring.evaluation.risk.sequence_model import load_sequence_model
from siren_ros.scoring.evaluation.risk.video_set import VideoSet, missing_files
from siren_ros.scoring.evaluation.scores import ALL, TEMPLATE, Score
from siren_ros.scoring.evaluation.statistics import BlockSums, interval_of_mean, rank_correlation
from siren_ros.scoring.judging.surrogate_safety import HORIZON_S

Answers = Mapping[str, RiskClass | None]
"""Final answer by video; None if nothing could be read from the model's answer."""

UNREADABLE = "unreadable"
"""Value in a file of answers for a text from which no class could be read."""
_FORMATS = 'JSON {"S1_000": "Normal", …} or CSV with the columns video and class'


def read_answers(path: Path) -> dict[str, RiskClass | None]:
    """Read a file of answers: one final class per video.

    Raises:
        InputError: A file that cannot be read, a video twice, or a class that is not known (with the first offender).
    """
    try:
        text = path.read_text(encoding="utf-8")
        pairs = _csv_pairs(text) if path.suffix.lower() == ".csv" else _json_pairs(text)
    except (OSError, ValueError, TypeError, KeyError, csv.Error) as error:
        raise InputError("predictions", str(path), f"{_FORMATS} ({error})") from error
    answers: dict[str, RiskClass | None] = {}
    for video, title in pairs:
        if video in answers:
            raise InputError("predictions", f"{path}: video {video}", "each video once")
        try:
            answers[video] = None if title == UNREADABLE else risk_class(title)
        except InputError as error:
            raise InputError("predictions", f"{path}: video {video}: {title}", error.allowed) from error
    return answers


def checked_answers(answers: Answers, videos: Collection[str], *, allow_missing: bool) -> dict[str, RiskClass | None]:
    """Check answers against the videos of a set.

    Raises:
        InputError: Answers to videos that the set does not have, or videos without an answer unless they are allowed;
            with their number and the first one.
    """
    unknown = sorted(set(answers) - set(videos))
    if unknown:
        raise InputError("predictions", f"{len(unknown)} unknown videos, first {unknown[0]}", "videos of the set")
    missing = sorted(set(videos) - set(answers))
    if missing and not allow_missing:
        allowed = "an answer to each video of the set, or --allow-missing"
        raise InputError("predictions", f"{len(missing)} videos without an answer, first {missing[0]}", allowed)
    return dict(answers)


def _json_pairs(text: str) -> list[tuple[str, str]]:
    pairs = plain_files.load_json(text, object_pairs_hook=lambda items: items)
    if not isinstance(pairs, list):
        raise ValueError("no object of video and class")  # noqa: TRY004 - what is in a file, not a call
    titles = []
    for video, value in pairs:
        title = dict(value).get("class") if isinstance(value, list) else value  # a list is an object's pairs here
        if not isinstance(title, str):
            raise ValueError("no object of video and class")  # noqa: TRY004 - what is in a file, not a call
        titles.append((str(video), title))
    return titles


def _csv_pairs(text: str) -> list[tuple[str, str]]:
    rows = csv.DictReader(text.splitlines())
    if not {"video", "class"} <= set(rows.fieldnames or ()):
        raise ValueError("no columns video and class")
    return [(row["video"], row["class"] or "") for row in rows]


def majority(videos: VideoSet) -> Answers:
    """Reference: the most frequent class of the set for every video; of equally frequent ones the least severe."""
    counts = Counter(video.label.risk for video in videos.videos.values())
    answer = min(counts, key=lambda risk: (-counts[risk], risk), default=RiskClass.NORMAL)
    return dict.fromkeys(videos.videos, answer)


def template_prior(videos: VideoSet) -> Answers:
    """Reference: the most frequent class of each template, the best answer from the template alone."""
    answers: dict[str, RiskClass | None] = {}
    for template in {video.template for video in videos.videos.values()}:
        of_template = {key: video for key, video in videos.videos.items() if video.template == template}
        answers |= majority(replace(videos, videos=of_template))
    return answers


def oracle(videos: VideoSet) -> Answers:
    """Reference: the class from the recorded measures, an upper bound that uses the simulator's state."""
    return {key: label_of(video.evidence, videos.thresholds).risk for key, video in videos.videos.items()}


def sequence(videos: VideoSet) -> Answers:
    """Reference: answers of the shipped network, which sees the pictures; videos without a file have none."""
    missing = missing_files(videos)
    present = {key: video for key, video in videos.videos.items() if key not in missing}
    return load_sequence_model().answers(replace(videos, videos=present))


REFERENCES: Final[Mapping[str, Callable[[VideoSet], Answers]]] = {
    "majority": majority,
    "template_prior": template_prior,
    "sequence": sequence,
    "oracle": oracle,
}
"""References by name; they are rows of every table."""


Confusion = npt.NDArray[np.int64]
"""Counts of videos, shape ``(3, 4)``: rows are reference classes, columns answers; the last column is unreadable
answers."""

NO_ANSWER: Final = len(RiskClass)
"""Column of unreadable answers. They count as wrong, and as an answer of no class."""


def confusion(reference: Sequence[RiskClass], answers: Sequence[RiskClass | None]) -> Confusion:
    """Count answers by reference class; None is an unreadable answer."""
    counts = np.zeros((len(RiskClass), len(RiskClass) + 1), dtype=np.int64)
    columns = [NO_ANSWER if answer is None else answer for answer in answers]
    np.add.at(counts, (np.array(reference, dtype=np.intp), np.array(columns, dtype=np.intp)), 1)
    return counts


def accuracy(counts: Confusion) -> Interval:
    """Share of correct answers."""
    return share_interval(int(np.trace(counts)), int(counts.sum()))


def precision(counts: Confusion, risk: RiskClass) -> Interval:
    """Share of correct answers among the answers of a class; not valid if the class was never answered."""
    return share_interval(int(counts[risk, risk]), int(counts[:, risk].sum()))


def recall(counts: Confusion, risk: RiskClass) -> Interval:
    """Share of a class's videos that were recognised; not valid if there are none."""
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
"""Scores by their name in tables and files."""


def correct_by_class(videos: VideoSet, answers: Answers) -> BlockSums:
    """Correct answers as sums over videos with the classes as strata: their mean is the balanced accuracy.

    ``answers`` has one for each video of the set.
    """
    labels = [(key, video.label.risk) for key, video in sorted(videos.videos.items())]
    right = np.array([float(answers[key] is risk) for key, risk in labels])
    return BlockSums(right, np.ones(len(right)), np.array([risk for _, risk in labels], dtype=np.intp))


@dataclass(frozen=True)
class ModelScores:
    """Scores of a model on a set."""

    name: str
    videos: int
    """Number of videos in the set."""
    answered: int
    """Number of videos with an answer; the others do not count."""
    overall: Confusion
    by_template: Mapping[str, Confusion]

    @property
    def scores(self) -> Mapping[str, Interval]:
        """All scores over the whole set, by name."""
        return {name: score(self.overall) for name, score in SCORES.items()}

    @property
    def rows(self) -> tuple[Score, ...]:
        """All scores over the whole set, then those of each template."""
        parts = {(ALL, ALL): self.overall, **{(TEMPLATE, name): counts for name, counts in self.by_template.items()}}
        return tuple(
            Score(self.name, *group, name, score(counts), int(counts.sum()))
            for group, counts in parts.items()
            for name, score in SCORES.items()
        )


def score_answers(name: str, videos: VideoSet, answers: Answers) -> ModelScores:
    """Score a model's answers; ``answers`` may contain only ids of the set."""
    answered = [(video, answers[key]) for key, video in sorted(videos.videos.items()) if key in answers]

    def counts(template: str | None = None) -> Confusion:
        of_template = [(video, answer) for video, answer in answered if template in (None, video.template)]
        return confusion([video.label.risk for video, _ in of_template], [answer for _, answer in of_template])

    templates = sorted({video.template for video, _ in answered})
    by_template = {template: counts(template) for template in templates}
    return ModelScores(name, len(videos.videos), len(answered), counts(), by_template)


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
            given = {key: value for key, value in plain_files.load_json(text).items() if isinstance(value, dict)}
        found = {key: Severity(*(float(value[name]) for name in MEASURES)) for key, value in given.items()}
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise InputError(
            "predictions", str(path), f"numbers {' and '.join(MEASURES)} of each video ({error})"
        ) from error
    for key, value in found.items():
        if not np.isfinite([value.least_ttc_s, value.contact_mps]).all():
            raise InputError("predictions", f"{path}: {key}", "finite numbers")
    return found


def score_severities(videos: VideoSet, given: Severities) -> Mapping[str, tuple[Interval, float | None]]:
    """Mean absolute error of estimates and Spearman's ρ with the truth by measure; no ρ if all estimates are equal.

    Videos without an estimate do not count; contact speed counts only videos with a contact.
    """
    truth = severities_of(videos)
    keys = sorted(set(truth) & set(given))
    scores = {}
    for name in MEASURES:
        counted = [key for key in keys if name != "contact_mps" or truth[key].contact_mps > 0.0]
        want, have = (np.array([getattr(of[key], name) for key in counted], dtype=float) for of in (truth, given))
        ranked = rank_correlation(want.tolist(), have.tolist())
        scores[name] = _mean_error(np.abs(want - have)), None if ranked is None else ranked.rho
    return scores


def _mean_error(errors: Floats) -> Interval:
    return interval_of_mean(BlockSums(errors, np.ones(len(errors)), np.zeros(len(errors), dtype=np.intp)))
