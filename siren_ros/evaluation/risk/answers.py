"""Answers to a set of videos: of a file that any program can write, and of references that need no language model."""

import csv
import json
from collections import Counter
from collections.abc import Callable, Collection, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Final

from siren_ros.errors import InputError
from siren_ros.evaluation.risk.labels import RiskClass, label_of, risk_class
from siren_ros.evaluation.risk.sequence_model import load_sequence_model
from siren_ros.evaluation.risk.video_set import VideoSet, missing_files

Answers = Mapping[str, RiskClass | None]
"""Final answer by video; None where the model answered and nothing could be read from it."""

UNREADABLE = "unreadable"
"""Stands in a file of answers in place of a class where nothing could be read from the model's text."""
_FORMATS = 'JSON {"S1_000": "Normal", …} or CSV with the columns video and class'


def read_answers(path: Path) -> dict[str, RiskClass | None]:
    """One final class for each video.

    Raises:
        InputError: A file that cannot be read, a video twice, or a class that is not known (with the first offender).
    """
    try:
        text = path.read_text(encoding="utf-8")
        pairs = _csv_pairs(text) if path.suffix.lower() == ".csv" else _json_pairs(text)
    except (OSError, ValueError, KeyError) as error:
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
    """The answers to the videos of a set.

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
    pairs = json.loads(text, object_pairs_hook=lambda items: items)
    if not isinstance(pairs, list) or not all(isinstance(title, str) for _, title in pairs):
        raise ValueError("no object of video and class")
    return [(str(video), title) for video, title in pairs]


def _csv_pairs(text: str) -> list[tuple[str, str]]:
    rows = csv.DictReader(text.splitlines())
    if not {"video", "class"} <= set(rows.fieldnames or ()):
        raise ValueError("no columns video and class")
    return [(row["video"], row["class"] or "") for row in rows]


def majority(videos: VideoSet) -> Answers:
    """The most frequent class of the set for every video; of equally frequent ones the least severe."""
    counts = Counter(video.label.risk for video in videos.videos.values())
    answer = min(counts, key=lambda risk: (-counts[risk], risk), default=RiskClass.NORMAL)
    return dict.fromkeys(videos.videos, answer)


def oracle(videos: VideoSet) -> Answers:
    """The class that the recorded measures give: the upper bound, which sees the simulator's state."""
    return {key: label_of(video.evidence, videos.thresholds).risk for key, video in videos.videos.items()}


def sequence(videos: VideoSet) -> Answers:
    """The answers of the shipped network, which sees the pictures; videos whose file is missing have none."""
    missing = missing_files(videos)
    present = {key: video for key, video in videos.videos.items() if key not in missing}
    return load_sequence_model().answers(replace(videos, videos=present))


REFERENCES: Final[Mapping[str, Callable[[VideoSet], Answers]]] = {
    "majority": majority,
    "sequence": sequence,
    "oracle": oracle,
}
"""Rows of every table, by name."""
