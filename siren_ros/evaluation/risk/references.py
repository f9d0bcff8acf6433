"""References that need no vision-language model: what a table without them cannot be read against."""

from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Final

from siren_ros.evaluation.risk.answers import Answers
from siren_ros.evaluation.risk.labels import label_of
from siren_ros.evaluation.risk.risk_class import RiskClass
from siren_ros.evaluation.risk.sequence.sequence_model import load_sequence_model
from siren_ros.evaluation.risk.video_set import VideoSet, missing_files


def majority(videos: VideoSet) -> Answers:
    """The most frequent class of the set for every video; of equally frequent ones the least severe."""
    counts = Counter(video.label.risk for video in videos.videos.values())
    answer = min(counts, key=lambda risk: (-counts[risk], risk), default=RiskClass.NORMAL)
    return dict.fromkeys(videos.videos, answer)


def oracle(videos: VideoSet) -> Answers:
    """The class that the recorded measures give: the upper bound, which sees the simulator's state."""
    return {key: label_of(video.evidence, videos.thresholds).risk for key, video in videos.videos.items()}


def sequence(videos: VideoSet) -> Answers:
    """What the shipped network sees in the pictures; videos whose file is missing have no answer."""
    lost = set(missing_files(videos))
    there = {key: video for key, video in videos.videos.items() if key not in lost}
    return load_sequence_model().answers(replace(videos, videos=there))


REFERENCES: Final[Mapping[str, Callable[[VideoSet], Answers]]] = {
    "majority": majority,
    "sequence": sequence,
    "oracle": oracle,
}
"""Rows of every table, by name."""
