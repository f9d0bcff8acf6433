"""Risk understanding: the balance of the classes, and the scores of the paper's models."""

from collections.abc import Iterator, Mapping
from typing import Any, Final

from siren_ros.evaluation.paper_comparison.compared import Compared
from siren_ros.evaluation.paper_comparison.stored_scores import interval_in
from siren_ros.evaluation.risk.reports.paper_table import PAPER_BALANCE, PAPER_SCORES
from siren_ros.evaluation.risk.risk_class import TITLES, RiskClass
from siren_ros.evaluation.risk.video_set import VideoSet
from siren_ros.evaluation.statistics.interval import NOTHING, Interval, share_interval

BALANCE: Final = "share of the videos"


def risk_rows(videos: VideoSet | None, content: Mapping[str, Any] | None) -> Iterator[Compared]:
    """All rows, those without a value of ours included.

    Args:
        videos: The set; None where there is none.
        content: ``scores.json`` of ``siren evaluate risk``; None where it was not run.
    """
    total = sum(PAPER_BALANCE)
    for risk, count in zip(RiskClass, PAPER_BALANCE, strict=True):
        yield Compared(BALANCE, "labels", TITLES[risk], count / total, _share(videos, risk))
    models = {} if content is None else content["models"]
    for name, scores in PAPER_SCORES.items():
        one = models.get(name)
        for score, value in scores.items():
            found = NOTHING if one is None else interval_in(one["scores"].get(score))
            yield Compared("risk scores", name, score, value, found, digits=3)


def _share(videos: VideoSet | None, risk: RiskClass) -> Interval:
    labels = [] if videos is None else [video.label.risk for video in videos.videos.values()]
    return share_interval(labels.count(risk), len(labels))
