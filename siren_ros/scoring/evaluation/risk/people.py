"""People's answers to a set: a page for labelling, reading of its files, and the agreement of people.

The page is blind: neither names nor order of its files tell template, class or number of a video. Name and order follow
from the rater's name, so that a file of answers needs no key.
"""

import json
from collections import Counter
from collections.abc import Mapping, Sequence
from hashlib import sha256
from itertools import combinations
from pathlib import Path
from typing import Final

import numpy as np
from markupsafe import Markup

from siren_ros.base.numerics.arrays import Floats
from siren_ros.base.params import plain_files
from siren_ros.base.tables import NOTHING, Interval, render_page
from siren_ros.errors import InputError, write_text, writing
from siren_ros.scoring.evaluation.risk.labels import TITLES, RiskClass, risk_class
from siren_ros.scoring.evaluation.risk.scoring import Answers
from siren_ros.scoring.evaluation.risk.video_set import VideoSet, key_frames
from siren_ros.scoring.evaluation.risk.vlm.pipeline import as_jpeg, video_frames
from siren_ros.scoring.evaluation.statistics import jackknife

PEOPLE: Final = "people"
"""Name of the row with the class that most people chose."""
QUESTION: Final = (
    "Normal: nobody comes close to a crash. Near-Miss: a crash is close; the ways of two vehicles meet within about a "
    "second, or somebody has to brake or swerve hard. Collision: the emergency vehicle touches another road user."
)
"""Explanation of the classes, the same as in the question to models."""


def blind_name(rater: str, video_id: str) -> str:
    """Name of a video on a person's page."""
    return sha256(f"{rater}/{video_id}".encode()).hexdigest()[:12]


def write_rating_page(videos: VideoSet, rater: str, folder: Path, *, pictures: bool = False) -> Path:
    """Write ``index.html`` and its files into a new or empty folder; returns the page.

    Args:
        videos: The set.
        rater: Name of the person; letters, digits, ``-`` and ``_``.
        folder: Where the page is written.
        pictures: Whether the nine key frames are shown in place of the video, as models see them.

    Raises:
        InputError: A name or folder that cannot be used, or a video that is missing.
    """
    if not rater or not all(letter.isalnum() or letter in "-_" for letter in rater):
        raise InputError("rater", rater, "a name of letters, digits, - and _")
    with writing(folder, "folder"):
        folder.mkdir(parents=True, exist_ok=True)
        if any(folder.iterdir()):
            raise InputError("out", str(folder), "a folder that is new or empty")
        items = []
        for name, key in sorted((blind_name(rater, key), key) for key in videos.videos):
            items.append({"id": name, "files": _shown(videos, key, folder, name, pictures=pictures)})
    content = json.dumps({"rater": rater, "items": items}).replace("</", "<\\/")
    text = render_page(
        "rating",
        rater=rater,
        classes=TITLES,
        question=QUESTION,
        items=Markup(content),  # noqa: S704 - JSON of our own names
    )
    write_text(folder / "index.html", text)
    return folder / "index.html"


def _shown(videos: VideoSet, key: str, folder: Path, name: str, *, pictures: bool) -> list[str]:
    """Write the files that the page shows for a video; returns their names."""
    video = videos.videos[key]
    source = videos.folder / video.file
    if not pictures:
        try:
            (folder / f"{name}.mp4").write_bytes(source.read_bytes())
        except FileNotFoundError as error:
            raise InputError("set", str(source), "a set with all its videos") from error
        return [f"{name}.mp4"]
    frames = key_frames(video.frames)
    files = []
    for number, picture in enumerate(video_frames(source, frames, video.frames)):
        files.append(f"{name}_{number}.jpg")
        (folder / files[-1]).write_bytes(as_jpeg(picture))
    return files


def read_rating(path: Path, videos: VideoSet) -> tuple[str, dict[str, RiskClass | None]]:
    """Read a person's file: the name, and the answers by the set's ids; videos without an answer are left out.

    Raises:
        InputError: Not a file of the page, or one of another set.
    """
    try:
        content = plain_files.read_json(path)
        rater, given = str(content["rater"]), dict(content["answers"])
        known = {blind_name(rater, key): key for key in videos.videos}
        answers = {known[name]: risk_class(title) for name, title in given.items()}
    except KeyError as error:
        raise InputError("people", str(path), f"answers to the videos of this set ({error})") from error
    except (OSError, ValueError, TypeError, AttributeError) as error:
        raise InputError("people", str(path), f"a file that the page of `siren rate` saved ({error})") from error
    return rater, dict(answers)


def consensus(ratings: Sequence[Answers]) -> dict[str, RiskClass | None]:
    """The class that most people chose for each video; of equally frequent ones the most severe."""
    answers: dict[str, RiskClass | None] = {}
    for key in sorted({key for rating in ratings for key in rating}):
        votes = Counter(vote for rating in ratings if (vote := rating.get(key)) is not None)
        if votes:
            answers[key] = max(votes, key=lambda risk: (votes[risk], risk))
    return answers


def cohens_kappa(first: Answers, second: Answers) -> Interval:
    """Cohen's κ of two raters over the videos that both answered, with the jackknife's interval over videos.

    1 where they always agree, 0 where they agree as often as chance would have it; not valid without a common video or
    where both give one class alone (J. Cohen, Educ. Psychol. Meas. 20 (1960) 37).
    """
    keys = sorted(key for key in set(first) & set(second) if first[key] is not None and second[key] is not None)
    pairs = np.zeros((len(keys), len(RiskClass), len(RiskClass)))
    for row, key in enumerate(keys):
        pairs[row, int(first[key] or 0), int(second[key] or 0)] = 1.0
    counts = pairs.sum(axis=0)
    value = float(_kappa(counts[None])[0])
    if not keys or not np.isfinite(value):
        return NOTHING
    return jackknife(value, _kappa(counts - pairs), np.zeros(len(keys), dtype=np.intp)).interval()


def _kappa(counts: Floats) -> Floats:
    """Compute κ from tables of shape ``(R, 3, 3)``; NaN where chance alone always agrees."""
    total = np.maximum(counts.sum(axis=(1, 2)), 1.0)
    agreed = np.trace(counts, axis1=1, axis2=2) / total
    chance = (counts.sum(axis=1) * counts.sum(axis=2)).sum(axis=1) / total**2
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.where(chance < 1.0, (agreed - chance) / (1.0 - chance), np.nan)


def agreement(videos: VideoSet, ratings: Mapping[str, Answers]) -> dict[tuple[str, str], Interval]:
    """κ of each pair of people, and of each person with the labels, by names."""
    labels: Answers = {key: video.label.risk for key, video in videos.videos.items()}
    everybody = {**ratings, "labels": labels}
    return {pair: cohens_kappa(everybody[pair[0]], everybody[pair[1]]) for pair in combinations(everybody, 2)}
