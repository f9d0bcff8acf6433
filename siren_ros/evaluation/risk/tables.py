"""The risk task's tables next to the paper's: for the terminal, as CSV, as LaTeX and as JSON."""

import csv
import io
from collections.abc import Mapping, Sequence
from typing import Any, Final

from siren_ros.evaluation.aligned_text import aligned
from siren_ros.evaluation.risk.labels import TITLES, RiskClass
from siren_ros.evaluation.risk.scoring import SCORES, ModelScores
from siren_ros.evaluation.statistics.interval import Interval, lack_of_bounds

PAPER_SCORES: Final[Mapping[str, Mapping[str, float]]] = {
    name: dict(
        zip(
            (
                "accuracy",
                "precision_normal",
                "f1_normal",
                "precision_near_miss",
                "f1_near_miss",
                "precision_collision",
                "f1_collision",
            ),
            (value / 100.0 for value in row),
            strict=True,
        )
    )
    for name, row in {
        "Blaifa-InternVL3.5-8B": (47.62, 84.21, 57.14, 28.12, 40.45, 0.00, 0.00),
        "Gemma3-12B": (26.67, 90.00, 21.43, 23.75, 36.19, 0.00, 0.00),
        "LLaVA-Llama3-8B": (22.86, 0.00, 0.00, 23.08, 37.21, 0.00, 0.00),
        "MiniCPM-V-4.5-8B": (49.52, 85.96, 74.81, 0.00, 0.00, 6.25, 11.11),
        "Qwen3.5-9B": (70.48, 70.48, 82.68, 0.00, 0.00, 0.00, 0.00),
    }.items()
}
"""Score by model and name, as shares. The paper prints percentages of 105 videos."""

PAPER_BALANCE: Final = (74, 25, 6)
"""Normal, Near-Miss, Collision. The paper does not print it; no other balance of 105 videos gives all its numbers."""


_COLUMNS: Final = {
    "Acc.": "accuracy",
    "bal. Acc.": "balanced_accuracy",
    "macro F1": "macro_f1",
    **{
        f"{short} {title}": f"{score}_{risk.name.lower()}"
        for risk, title in zip(RiskClass, TITLES, strict=True)
        for short, score in (("P", "precision"), ("R", "recall"), ("F1", "f1"))
    },
}
"""Heading and score of the printed columns."""
_BOUNDED: Final = ("accuracy", "macro_f1")
"""Printed with their intervals."""


def text_table(models: Sequence[ModelScores], *, compare_paper: bool) -> list[str]:
    """Lines for a terminal: percentages, with the interval of the accuracy and of macro F1; - where not valid."""
    rows = [["model", "videos", *_COLUMNS]]
    for model in models:
        scores = model.scores
        cells = [
            f"{100.0 * score.value:.2f}" + (_bounds(score) if name in _BOUNDED else "") if score.valid else "-"
            for name, score in ((name, scores[name]) for name in _COLUMNS.values())
        ]
        rows.append([model.name, f"{model.answered}/{model.videos}", *cells])
    if compare_paper:
        for name, paper in PAPER_SCORES.items():
            cells = [f"{100.0 * paper[score]:.2f}" if score in paper else "" for score in _COLUMNS.values()]
            rows.append([f"{name} (paper)", "105", *cells])
    return [*aligned(rows), *lack_of_bounds(model.scores[name] for model in models for name in _BOUNDED)]


def confusion_lines(model: ModelScores) -> list[str]:
    """A model's confusion matrices, overall and by template; rows are the labels, columns the answers."""
    rows = [[model.name, "label", *TITLES, "unreadable"]]
    for name, counts in (("all", model.overall), *model.by_template.items()):
        rows += [
            [name if risk == 0 else "", TITLES[risk], *(str(value) for value in counts[risk])] for risk in RiskClass
        ]
    return aligned(rows)


def csv_table(models: Sequence[ModelScores]) -> str:
    """One row for each model, group (all or a template) and score; without value where not valid."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["model", "group", "score", "value", "low", "high", "videos"])
    for model in models:
        for group, counts in (("all", model.overall), *model.by_template.items()):
            for name, score in SCORES.items():
                found = score(counts)
                value = f"{found.value:.6f}" if found.valid else ""
                bounds = ["", ""]
                if group == "all" and found.bounded:
                    bounds = [f"{found.low:.6f}", f"{found.high:.6f}"]
                writer.writerow([model.name, group, name, value, *bounds, int(counts.sum())])
    return text.getvalue()


def latex_table(models: Sequence[ModelScores], *, compare_paper: bool) -> str:
    """The paper's table: accuracy, and precision and F1 of each class, in percent."""
    names = ["accuracy", *(f"{score}_{risk.name.lower()}" for risk in RiskClass for score in ("precision", "f1"))]
    lines = [
        r"\begin{tabular}{@{}lccccccc@{}}",
        r"\toprule",
        " & & " + " & ".join(rf"\multicolumn{{2}}{{c}}{{{title}}}" for title in TITLES) + r" \\",
        "Model & Acc. & " + " & ".join(["Prec. & F1"] * len(TITLES)) + r" \\",
        r"\midrule",
    ]
    for model in models:
        scores = model.scores
        lines.append(_latex_row(model.name, [scores[name].value for name in names]))
    if compare_paper:
        lines.append(r"\midrule")
        lines += [
            _latex_row(f"{name} (paper)", [paper[score] for score in names]) for name, paper in PAPER_SCORES.items()
        ]
    return "\n".join([*lines, r"\bottomrule", r"\end{tabular}"]) + "\n"


def as_json(models: Sequence[ModelScores]) -> dict[str, Any]:
    """Everything: scores with intervals, and the confusion matrices (rows labels; columns answers, then unreadable)."""
    return {
        "classes": list(TITLES),
        "models": {
            model.name: {
                "videos": model.videos,
                "answered": model.answered,
                "scores": {
                    name: {
                        "value": score.value if score.valid else None,
                        "low": score.low if score.bounded else None,
                        "high": score.high if score.bounded else None,
                        "episodes": score.blocks,
                    }
                    for name, score in model.scores.items()
                },
                "confusion": model.overall.tolist(),
                "confusion_by_template": {key: counts.tolist() for key, counts in model.by_template.items()},
            }
            for model in models
        },
    }


def _bounds(score: Interval) -> str:
    return f" [{100.0 * score.low:.0f}, {100.0 * score.high:.0f}]" if score.bounded else " [-]"


def _latex_row(name: str, values: Sequence[float]) -> str:
    escaped = name.replace("_", r"\_").replace("%", r"\%").replace("&", r"\&")
    return " & ".join([escaped, *(f"{100.0 * value:.2f}" for value in values)]) + r" \\"
