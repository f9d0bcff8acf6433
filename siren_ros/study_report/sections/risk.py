"""Section: risk understanding, from the scores that ``siren evaluate risk`` wrote."""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

from siren_ros.evaluation.paper_comparison.stored_scores import interval_in
from siren_ros.evaluation.statistics.interval import NOTHING, Interval
from siren_ros.study_report.cells import with_interval
from siren_ros.study_report.commands import quoted
from siren_ros.study_report.content import Section, Table
from siren_ros.study_report.stored_tables import stored_tables

_SCORES: Final = (
    ("accuracy", "accuracy"),
    ("balanced accuracy", "balanced_accuracy"),
    ("macro F1", "macro_f1"),
    ("F1 normal", "f1_normal"),
    ("F1 near-miss", "f1_near_miss"),
    ("F1 collision", "f1_collision"),
)


def risk_section(folder: Path) -> Section | None:
    """The models' scores; None where there are none."""
    tables = stored_tables("risk", folder, _tables)
    if tables is None:
        return None
    text = (
        "Each video is normal, a near-miss or a collision. Values are percentages, intervals 95 % over "
        "videos. The rows majority and oracle answer the commonest class and the label itself."
    )
    call = f"./env siren evaluate risk SET --predictions NAME=FILE --out {quoted(folder)}"
    return Section("risk", "Task: risk understanding", (text,), tables=tables, commands=(call,))


def _tables(content: Mapping[str, Any]) -> Iterator[Table]:
    models = content["models"]
    rows = [
        (
            name,
            f"{one['answered']} of {one['videos']}",
            *(with_interval(_percent(one["scores"].get(key)), 1) for _, key in _SCORES),
        )
        for name, one in models.items()
    ]
    head = ("model", "videos", *(title for title, _ in _SCORES))
    yield Table("risk_models", "Scores in percent", head, tuple(rows))
    classes = tuple(content["classes"])
    rows = [
        (name, title, *map(str, counts))
        for name, one in models.items()
        for title, counts in zip(classes, one["confusion"], strict=True)
    ]
    head = ("model", "label", *(f"answered {title}" for title in classes), "unreadable")
    yield Table("risk_confusion", "Confusion matrices", head, tuple(rows), folded=True)


def _percent(score: Mapping[str, Any] | None) -> Interval:
    found = interval_in(score)
    if not found.valid:
        return NOTHING
    return replace(found, value=100.0 * found.value, low=100.0 * found.low, high=100.0 * found.high)
