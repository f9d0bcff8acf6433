"""The report on risk: tables beside the paper's, all scores as JSON, and the page of a set of videos.

The page shows each video with its label, its measures over time and the answers. Confusion matrices are a picture.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from os.path import relpath
from pathlib import Path
from typing import Any, Final, NamedTuple
from urllib.parse import quote

import numpy as np
from matplotlib.figure import Figure

from siren_ros.base.numerics.arrays import Floats
from siren_ros.base.numerics.units import STEP_S
from siren_ros.base.tables import Cell, Interval, Row, Table, render_page
from siren_ros.errors import whole_file, writing
from siren_ros.scoring.evaluation.risk.labels import TITLES, Reason, RiskClass, RiskThresholds
from siren_ros.scoring.evaluation.risk.scoring import (
    MEASURES,
    UNREADABLE,
    Answers,
    ModelScores,
    Severities,
    score_severities,
    template_means,
)
from siren_ros.scoring.evaluation.risk.video_set import RiskVideo, VideoSet, changes_of_labels
from siren_ros.scoring.evaluation.scores import ALL, Scores

_PAPER_COLUMNS: Final = (
    "accuracy",
    *(f"{score}_{risk.name.lower()}" for risk in RiskClass for score in ("precision", "f1")),
)
PAPER_SCORES: Final[Mapping[str, Mapping[str, float]]] = {
    name: dict(zip(_PAPER_COLUMNS, (value / 100.0 for value in row), strict=True))
    for name, row in {
        "Blaifa-InternVL3.5-8B": (47.62, 84.21, 57.14, 28.12, 40.45, 0.00, 0.00),
        "Gemma3-12B": (26.67, 90.00, 21.43, 23.75, 36.19, 0.00, 0.00),
        "LLaVA-Llama3-8B": (22.86, 0.00, 0.00, 23.08, 37.21, 0.00, 0.00),
        "MiniCPM-V-4.5-8B": (49.52, 85.96, 74.81, 0.00, 0.00, 6.25, 11.11),
        "Qwen3.5-9B": (70.48, 70.48, 82.68, 0.00, 0.00, 0.00, 0.00),
    }.items()
}
"""The paper's scores by model and name, as shares; it prints percentages of 105 videos."""

PAPER_BALANCE: Final = (74, 25, 6)
"""Number of videos per class (Normal, Near-Miss, Collision) in the paper. The paper does not print it; no other split
of 105 videos gives all its numbers."""

_OVERALL: Final = {"accuracy": "accuracy", "balanced accuracy": "balanced_accuracy", "macro F1": "macro_f1"}
_OF_CLASSES: Final = {
    f"{short} {risk.title}": f"{score}_{risk.name.lower()}"
    for risk in RiskClass
    for short, score in (("P", "precision"), ("R", "recall"), ("F1", "f1"))
}
"""Column titles with the names of their scores."""
_PAPER_VIDEOS: Final = "105"
_TRIVIAL: Final = frozenset({"majority", "template_prior", "oracle"})
"""References whose confusion matrices follow from the labels."""


def tables_of(content: Mapping[str, Any], *, compare_paper: bool = False) -> tuple[Table, ...]:
    """Tables of scores in percent, with the paper's rows below ours on request, and confusion matrices.

    They are made from the content of ``scores.json`` (``scores_as_json``), so that a page of stored scores shows the
    tables of the terminal.
    """
    scores, models, paper = Scores.of_json(content), content["models"], PAPER_SCORES if compare_paper else {}
    answers = ("label", *(f"answered {title}" for title in content["classes"]), "unreadable")

    def labelled(counts: Sequence[Sequence[int]]) -> Iterator[Row]:
        """Rows of a confusion matrix with their labels in front."""
        for title, row in zip(content["classes"], counts, strict=True):
            yield (title, *row)

    tables = (
        Table(
            "scores",
            "Scores in percent",
            ("model", "videos", *_OVERALL),
            tuple(
                (name, (model["answered"], model["videos"]), *_percent(scores, name, _OVERALL))
                for name, model in models.items()
            ),
            reference=tuple(
                (f"{name} (paper)", _PAPER_VIDEOS, *_paper_percent(row, _OVERALL)) for name, row in paper.items()
            ),
        ),
        Table(
            "classes",
            "Precision (P), recall (R) and F1 of the classes in percent",
            ("model", *_OF_CLASSES),
            tuple((name, *_percent(scores, name, _OF_CLASSES)) for name in models),
            reference=tuple((f"{name} (paper)", *_paper_percent(row, _OF_CLASSES)) for name, row in paper.items()),
        ),
        Table(
            "confusion",
            "Confusion matrices",
            ("model", *answers),
            tuple((name, *row) for name, model in models.items() for row in labelled(model["confusion"])),
            folded=True,
        ),
        Table(
            "confusion_by_template",
            "Confusion matrices by template",
            ("model", "template", *answers),
            tuple(
                (name, template, *row)
                for name, model in models.items()
                if name not in _TRIVIAL
                for template, counts in model["confusion_by_template"].items()
                for row in labelled(counts)
            ),
            folded=True,
        ),
    )
    return tuple(table for table in tables if table.rows)


def table_of_changes(videos: VideoSet) -> Table:
    """Table of how a set's labels change with their thresholds."""
    rows = changes_of_labels(videos)
    head = ("threshold", "value", *TITLES, "changed")
    shown = tuple((row.name, None if row.value == 1.0 else row.value, *row.counts, row.changed) for row in rows)
    return Table("thresholds", "Labels by other thresholds", head, shown)


def table_of_severity(videos: VideoSet, given: Mapping[str, Severities]) -> Table:
    """Table of how well models estimate severity; the mean of each template is an estimate, too."""
    rows = []
    for name, guesses in ({"template_prior": template_means(videos)} | dict(given)).items():
        scores = score_severities(videos, guesses)
        rows.append((name, *chain.from_iterable(scores.values())))
    titles = [title for measure in MEASURES.values() for title in (f"error of {measure}", f"ρ of {measure}")]
    return Table("severity", "Severity: mean absolute error and rank correlation", ("model", *titles), tuple(rows))


def table_of_agreement(kappas: Mapping[tuple[str, str], Interval]) -> Table:
    """Table of the agreement of people with each other and with the labels."""
    rows = tuple((*pair, kappa) for pair, kappa in kappas.items())
    return Table("agreement", "Agreement (Cohen's κ)", ("first", "second", "κ"), rows)


def _percent(scores: Scores, model: str, columns: Mapping[str, str]) -> Iterator[Cell]:
    """Cells of a model's scores; precision and recall have no interval, since F1 follows from them."""
    for title, score in columns.items():
        percent = scores.interval(model, ALL, ALL, score).scaled(100.0)
        without_interval = title.startswith(("P ", "R "))
        yield (percent.value if percent.valid else None) if without_interval else percent


def _paper_percent(scores: Mapping[str, float], columns: Mapping[str, str]) -> Iterator[float | None]:
    return (100.0 * scores[score] if score in scores else None for score in columns.values())


def scores_as_json(models: Sequence[ModelScores]) -> dict[str, Any]:
    """Rows of scores, and confusion matrices (rows: labels; columns: answers, then unreadable)."""
    return {
        "task": "risk",
        "rows": [row.json() for model in models for row in model.rows],
        "classes": list(TITLES),
        "models": {
            model.name: {
                "videos": model.videos,
                "answered": model.answered,
                "confusion": model.overall.tolist(),
                "confusion_by_template": {key: counts.tolist() for key, counts in model.by_template.items()},
            }
            for model in models
        },
    }


FRAME_S: Final = 0.1
"""Time between frames of a video."""


class Dot(NamedTuple):
    """An event in a chart: a time in the video and a value."""

    at_s: float
    value: float


@dataclass(frozen=True)
class Curves:
    """Measures at each step of a video's window; NaN where no vehicle is on a collision course."""

    time_s: Floats
    """Time since the first frame, shape ``(N,)``."""
    time_to_collision_s: Floats
    """Smallest TTC among the civilians that count, shape ``(N,)``."""
    required_deceleration_mps2: Floats
    """Largest DRAC among the civilians near enough to count, shape ``(N,)``."""
    encroachments: tuple[Dot, ...]
    """PET of each civilian whose path the EMV crossed."""
    contacts: tuple[Dot, ...]
    """Contacts with their impact speeds in m/s."""
    moment_s: float | None
    """Time of the conflict that decided the label; None if there is none."""


def curves_of(video: RiskVideo, thresholds: RiskThresholds) -> Curves:
    """Compute the curves of a video; the thresholds leave out slow closing and far vehicles, as for labels."""
    count = round(video.frames * FRAME_S / STEP_S)
    moments, first = video.evidence.moments, video.first_step
    inside = (moments.step >= first) & (moments.step < first + count)
    closing = inside & (moments.closing_mps > thresholds.closing_mps)
    near = inside & (moments.gap_m < thresholds.gap_m)
    least, most = np.full(count, np.nan), np.full(count, np.nan)
    np.fmin.at(least, moments.step[closing] - first, moments.time_to_collision_s[closing])
    np.fmax.at(most, moments.step[near] - first, moments.required_deceleration_mps2[near])

    def second(step: int) -> float:
        return (step - first) * STEP_S

    return Curves(
        np.arange(count) * STEP_S,
        least,
        most,
        tuple(Dot(second(pet.step), pet.time_s) for pet in video.evidence.encroachments),
        tuple(Dot(second(hit.step), hit.impact_mps) for hit in video.evidence.contacts),
        second(video.label.step) if video.label.actor_id else None,
    )


WIDTH: Final = 380.0
HEIGHT: Final = 64.0
_TIME_TO_COLLISION_MAX_S: Final = 5.0
_DECELERATION_MAX_MPS2: Final = 10.0
_ENCROACHMENT_MAX_S: Final = 5.0


@dataclass(frozen=True)
class Chart:
    """Chart of one measure over a video; coordinates in a box of WIDTH by HEIGHT, y downwards."""

    title: str
    unit: str
    top: float
    """Value at the upper edge; larger values are drawn there."""
    limit: float
    """Threshold of a near-miss."""
    limit_y: float
    path: str
    """SVG path of the curve; empty without values."""
    dots: tuple[tuple[float, float, str], ...]
    """Dots with x, y and text."""
    extreme: str
    """The most critical value and its time, as text."""


def charts_of(curves: Curves, thresholds: RiskThresholds) -> tuple[Chart, ...]:
    """Charts of TTC, PET and DRAC of a video."""
    time_s = curves.time_s
    across = WIDTH / (len(time_s) * (time_s[1] - time_s[0]))

    def line(
        title: str, unit: str, values: Floats, top: float, limit: float, worst: Callable[[Floats], np.intp]
    ) -> Chart:
        known = np.flatnonzero(np.isfinite(values))
        at = known[worst(values[known])] if len(known) else None
        extreme = "" if at is None else _text_of(time_s[at], values[at], unit)
        return Chart(title, unit, top, limit, _y(limit, top), _svg_path(time_s * across, values, top), (), extreme)

    ttc, drac = curves.time_to_collision_s, curves.required_deceleration_mps2
    top, limit = _ENCROACHMENT_MAX_S, thresholds.post_encroachment_s
    dots = curves.encroachments
    drawn = tuple((at_s * across, _y(value, top), _text_of(at_s, value, "s")) for at_s, value in dots)
    least = _text_of(*min(dots, key=lambda dot: dot.value), "s") if dots else ""
    return (
        line("TTC", "s", ttc, _TIME_TO_COLLISION_MAX_S, thresholds.time_to_collision_s, np.argmin),
        Chart("PET", "s", top, limit, _y(limit, top), "", drawn, least),
        line("DRAC", "m/s²", drac, _DECELERATION_MAX_MPS2, thresholds.required_deceleration_mps2, np.argmax),
    )


def _text_of(at_s: float, value: float, unit: str) -> str:
    return f"{value:.2f} {unit} at {at_s:.1f} s"


def _svg_path(x: Floats, values: Floats, top: float) -> str:
    """SVG path of a curve with gaps where a value is missing; a single value becomes a short line."""
    parts, drawing = [], False
    for at, value in zip(x.tolist(), values.tolist(), strict=True):
        if not np.isfinite(value):
            drawing = False
            continue
        place = f"{at:.1f} {_y(value, top):.1f}"
        parts.append(f"L{place}" if drawing else f"M{place}h0.6")
        drawing = True
    return "".join(parts)


def _y(value: float, top: float) -> float:
    return HEIGHT * (1.0 - min(max(value, 0.0), top) / top)


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
    """Title of the class, "unreadable", or "none" without an answer."""
    right: bool


@dataclass(frozen=True)
class Card:
    """Content of the page's card for one video."""

    video_id: str
    template: str
    label: str
    reason: str
    source: str
    """Address of the video file relative to the page; empty if the file is missing."""
    length_s: float
    moment_s: float | None
    charts: tuple[Chart, ...]
    contacts: tuple[Dot, ...]
    answers: tuple[Answer, ...]
    preset: str

    @property
    def right(self) -> str:
        """Numbers of the models that answered correctly, for the page's filter."""
        return " ".join(str(number) for number, answer in enumerate(self.answers) if answer.right)


def write_page(path: Path, videos: VideoSet, answers: Mapping[str, Answers], models: Sequence[ModelScores]) -> None:
    """Write the page: one HTML file that needs no network; the videos stay where they are.

    The answers are by the models' names; the page has the order of the scores.

    Raises:
        InputError: The file cannot be written.
    """
    named = {model.name: answers[model.name] for model in models}
    cards = [card_of(videos, key, named, path.parent) for key in sorted(videos.videos)]
    text = render_page(
        "risk",
        cards=cards,
        classes=TITLES,
        counts=[sum(card.label == title for card in cards) for title in TITLES],
        templates=sorted({card.template for card in cards}),
        models=models,
        width=WIDTH,
        height=HEIGHT,
    )
    with writing(path, parameter="page"):
        path.parent.mkdir(parents=True, exist_ok=True)
        with whole_file(path) as file:
            file.write_text(text, encoding="utf-8")


def card_of(videos: VideoSet, video_id: str, answers: Mapping[str, Answers], folder: Path) -> Card:
    """Make the card of a video for a page in a folder."""
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
        answers=tuple(_answer(model, given, video) for model, given in answers.items()),
        preset=str(video.request.get("preset", "")),
    )


def _answer(model: str, given: Answers, video: RiskVideo) -> Answer:
    if video.video_id not in given:
        return Answer(model, "none", right=False)
    answer = given[video.video_id]
    return Answer(model, UNREADABLE if answer is None else answer.title, right=answer is video.label.risk)


_COLUMNS: Final = 4
_PANEL_IN: Final = (3.1, 2.9)
_TITLE_PT, _TEXT_PT, _ANSWERS_PT = 10, 8, 7
_DARK: Final = 0.6
"""Share above which numbers are written in white."""
_DPI: Final = 110


def save_confusions(model: ModelScores, path: Path) -> None:
    """Draw all confusion matrices of a model; shades are shares of each label's videos, numbers are counts."""
    groups = [("all templates", model.overall), *model.by_template.items()]
    rows = -(-len(groups) // _COLUMNS)
    figure = Figure(figsize=(_PANEL_IN[0] * _COLUMNS, _PANEL_IN[1] * rows), layout="constrained")
    panels = figure.subplots(rows, _COLUMNS, squeeze=False).ravel()
    for panel, (name, counts) in zip(panels, groups, strict=False):
        totals = counts.sum(axis=1, keepdims=True)
        panel.imshow(counts / totals.clip(1), vmin=0.0, vmax=1.0, cmap="Blues")
        for row, values in enumerate(counts.tolist()):
            for column, count in enumerate(values):
                dark = count >= _DARK * max(1, int(totals[row, 0]))
                panel.text(column, row, str(count), ha="center", va="center", color="white" if dark else "black")
        panel.set_title(f"{name} (n = {int(counts.sum())})", fontsize=_TITLE_PT)
        panel.set_xticks(range(len(TITLES) + 1), [*TITLES, "none"], fontsize=_ANSWERS_PT)
        panel.set_yticks(range(len(TITLES)), TITLES, fontsize=_TEXT_PT, rotation=90, va="center")
        panel.set_xlabel("answer", fontsize=_TEXT_PT)
        panel.set_ylabel("label", fontsize=_TEXT_PT)
    for panel in panels[len(groups) :]:
        panel.set_visible(False)
    figure.suptitle(model.name)
    with whole_file(path) as file:
        figure.savefig(file, dpi=_DPI)
