"""Writes the page."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from os.path import relpath
from pathlib import Path
from typing import Final
from urllib.parse import quote

from siren_ros.errors import whole_file, writing
from siren_ros.evaluation.risk.answers import Answers
from siren_ros.evaluation.risk.labels import Reason
from siren_ros.evaluation.risk.page.charts import HEIGHT, WIDTH, Chart, charts_of
from siren_ros.evaluation.risk.page.curves import Dot, curves_of
from siren_ros.evaluation.risk.risk_class import TITLES, RiskClass
from siren_ros.evaluation.risk.scoring import ModelScores
from siren_ros.evaluation.risk.video_set import RiskVideo, VideoSet
from siren_ros.params.page_files import page_part, page_template

_PAGE: Final = "risk"
_REASONS: Final[Mapping[Reason, str]] = {
    Reason.NOTHING: "no conflict",
    Reason.TIME_TO_COLLISION: "TTC {value:.2f} s",
    Reason.POST_ENCROACHMENT: "PET {value:.2f} s",
    Reason.REQUIRED_DECELERATION: "DRAC {value:.1f} m/s²",
    Reason.CONTACT: "contact at {value:.1f} m/s",
}


@dataclass(frozen=True)
class Answer:
    """A model's answer to one video."""

    model: str
    title: str
    """Of the class; "unreadable", or "none" where the model has not answered."""
    right: bool


@dataclass(frozen=True)
class Card:
    """Everything that the page shows of one video."""

    video_id: str
    template: str
    label: str
    reason: str
    source: str
    """Address of the file from the page; empty where it is missing."""
    length_s: float
    moment_s: float | None
    charts: tuple[Chart, ...]
    contacts: tuple[Dot, ...]
    answers: tuple[Answer, ...]
    preset: str

    @property
    def right(self) -> str:
        """Numbers of the models that are right, for the filter."""
        return " ".join(str(number) for number, answer in enumerate(self.answers) if answer.right)


def write_page(path: Path, videos: VideoSet, answers: Mapping[str, Answers], models: Sequence[ModelScores]) -> None:
    """Writes the page: one HTML file that needs no network; the videos stay where they are.

    Args:
        path: HTML file to write.
        videos: The set.
        answers: Of each model, by its name.
        models: Their scores, in the order of the page.

    Raises:
        InputError: The file cannot be written.
    """
    named = {model.name: answers[model.name] for model in models}
    cards = [card_of(videos, key, named, path.parent) for key in sorted(videos.videos)]
    text = page_template(_PAGE, trim_blocks=True).render(
        cards=cards,
        classes=TITLES,
        counts=[sum(card.label == title for card in cards) for title in TITLES],
        templates=sorted({card.template for card in cards}),
        models=models,
        width=WIDTH,
        height=HEIGHT,
        style=page_part(_PAGE, "page.css"),
        script=page_part(_PAGE, "page.js"),
    )
    with writing(path, parameter="page"):
        path.parent.mkdir(parents=True, exist_ok=True)
        with whole_file(path) as file:
            file.write_text(text, encoding="utf-8")


def card_of(videos: VideoSet, video_id: str, answers: Mapping[str, Answers], folder: Path) -> Card:
    """What the page in a folder shows of a video."""
    video = videos.videos[video_id]
    curves = curves_of(video, videos.thresholds)
    file = videos.folder / video.file
    return Card(
        video_id=video_id,
        template=video.template,
        label=video.label.risk.title,
        reason=_REASONS[video.label.reason].format(value=video.label.value),
        source=quote(Path(relpath(file, folder)).as_posix()) if file.is_file() else "",
        length_s=len(curves.time_s) * float(curves.time_s[1] - curves.time_s[0]),
        moment_s=curves.moment_s,
        charts=charts_of(curves, videos.thresholds),
        contacts=curves.contacts,
        answers=tuple(_answer(name, given, video) for name, given in answers.items()),
        preset=str(video.request.get("preset", "")),
    )


def _answer(name: str, given: Answers, video: RiskVideo) -> Answer:
    if video.video_id not in given:
        return Answer(name, "none", right=False)
    answer: RiskClass | None = given[video.video_id]
    return Answer(name, "unreadable" if answer is None else answer.title, right=answer is video.label.risk)
