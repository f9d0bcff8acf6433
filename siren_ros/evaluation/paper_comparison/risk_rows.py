"""Risk understanding: the balance of the classes, and the scores of the paper's models."""

from collections.abc import Iterator, Mapping
from typing import Any, Final

import numpy as np

from siren_ros.evaluation.paper_comparison.compared import Compared
from siren_ros.evaluation.paper_comparison.stored_scores import interval_in
from siren_ros.evaluation.risk.reports.paper_table import PAPER_BALANCE, PAPER_SCORES
from siren_ros.evaluation.risk.risk_class import TITLES, RiskClass
from siren_ros.evaluation.risk.video_set import VideoSet
from siren_ros.evaluation.statistics.block_bootstrap import interval_of
from siren_ros.evaluation.statistics.interval import NOTHING, Interval
from siren_ros.numerics.random_streams import random_stream

BALANCE: Final = "share of the videos"


def risk_rows(videos: VideoSet | None, content: Mapping[str, Any] | None, seed: int = 0) -> Iterator[Compared]:
    """All rows, those without a value of ours included.

    Args:
        videos: The set; None where there is none.
        content: ``scores.json`` of ``siren evaluate risk``; None where it was not run.
        seed: Of the bootstrap over videos.
    """
    total = sum(PAPER_BALANCE)
    for risk, count in zip(RiskClass, PAPER_BALANCE, strict=True):
        yield Compared(BALANCE, "labels", TITLES[risk], count / total, _share(videos, risk, seed))
    models = {} if content is None else content["models"]
    for name, scores in PAPER_SCORES.items():
        one = models.get(name)
        for score, value in scores.items():
            found = NOTHING if one is None else interval_in(one["scores"].get(score))
            yield Compared("risk scores", name, score, value, found, digits=3)


def _share(videos: VideoSet | None, risk: RiskClass, seed: int) -> Interval:
    if videos is None or not videos.videos:
        return NOTHING
    ordered = [videos.videos[key] for key in sorted(videos.videos)]
    is_risk = np.array([video.label.risk is risk for video in ordered], dtype=np.float64)
    _, stratum = np.unique([video.template for video in ordered], return_inverse=True)
    return interval_of(
        lambda rows: float(is_risk[rows].mean()), stratum.astype(np.intp), random_stream(seed, f"paper/balance/{risk}")
    )
