"""Tables of the risk task beside the paper's, and all scores as JSON and CSV."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final

from siren_ros.base.tables.interval import Interval, interval_of_json
from siren_ros.base.tables.table import Cell, Row, Table, csv_text
from siren_ros.scoring.evaluation.risk.labels import TITLES, RiskClass
from siren_ros.scoring.evaluation.risk.scoring import SCORES, ModelScores
from siren_ros.scoring.evaluation.risk.severity import MEASURES, Severities, score_severities, template_means
from siren_ros.scoring.evaluation.risk.video_set import VideoSet, changes_of_labels

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
    models, paper = content["models"], PAPER_SCORES if compare_paper else {}
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
                (name, (model["answered"], model["videos"]), *_percent(model, _OVERALL))
                for name, model in models.items()
            ),
            reference=tuple(
                (f"{name} (paper)", _PAPER_VIDEOS, *_paper_percent(scores, _OVERALL)) for name, scores in paper.items()
            ),
        ),
        Table(
            "classes",
            "Precision (P), recall (R) and F1 of the classes in percent",
            ("model", *_OF_CLASSES),
            tuple((name, *_percent(model, _OF_CLASSES)) for name, model in models.items()),
            reference=tuple(
                (f"{name} (paper)", *_paper_percent(scores, _OF_CLASSES)) for name, scores in paper.items()
            ),
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
        rows.append((name, *(part for score in scores.values() for part in (score.error, score.rank_correlation))))
    titles = [title for measure in MEASURES.values() for title in (f"error of {measure}", f"ρ of {measure}")]
    return Table("severity", "Severity: mean absolute error and rank correlation", ("model", *titles), tuple(rows))


def table_of_agreement(kappas: Mapping[tuple[str, str], Interval]) -> Table:
    """Table of the agreement of people with each other and with the labels."""
    rows = tuple((*pair, kappa) for pair, kappa in kappas.items())
    return Table("agreement", "Agreement (Cohen's κ)", ("first", "second", "κ"), rows)


def _percent(model: Mapping[str, Any], columns: Mapping[str, str]) -> Iterator[Cell]:
    """Cells of a model's scores; precision and recall have no interval, since F1 follows from them."""
    for title, score in columns.items():
        percent = interval_of_json(model["scores"].get(score)).scaled(100.0)
        without_interval = title.startswith(("P ", "R "))
        yield (percent.value if percent.valid else None) if without_interval else percent


def _paper_percent(scores: Mapping[str, float], columns: Mapping[str, str]) -> Iterator[float | None]:
    return (100.0 * scores[score] if score in scores else None for score in columns.values())


def csv_of_scores(models: Sequence[ModelScores]) -> str:
    """CSV with one row per model, group (all or a template) and score; the value is empty if not valid."""
    rows = []
    for model in models:
        for group, counts in (("all", model.overall), *model.by_template.items()):
            for name, score in SCORES.items():
                interval = score(counts)
                value = f"{interval.value:.6f}" if interval.valid else None
                bounded = group == "all" and interval.bounded
                bounds = [f"{bound:.6f}" if bounded else None for bound in (interval.low, interval.high)]
                rows.append((model.name, group, name, value, *bounds, int(counts.sum())))
    return csv_text(("model", "group", "score", "value", "low", "high", "videos"), rows)


def scores_as_json(models: Sequence[ModelScores]) -> dict[str, Any]:
    """All scores with intervals, and confusion matrices (rows: labels; columns: answers, then unreadable)."""
    return {
        "classes": list(TITLES),
        "models": {
            model.name: {
                "videos": model.videos,
                "answered": model.answered,
                "scores": {name: score.json() for name, score in model.scores.items()},
                "confusion": model.overall.tolist(),
                "confusion_by_template": {key: counts.tolist() for key, counts in model.by_template.items()},
            }
            for model in models
        },
    }
