"""The scores as tables, for the terminal, as CSV and as LaTeX."""

import csv
import io
from collections.abc import Sequence
from dataclasses import dataclass

from siren_ros.evaluation.aligned_text import aligned
from siren_ros.evaluation.detection.metrics.devkit_score import ERRORS
from siren_ros.evaluation.detection.reports.paper_results import MEAN, PaperDetector, paper_rows
from siren_ros.evaluation.detection.scoring import DetectorScores
from siren_ros.evaluation.statistics.interval import NOTHING, Interval

_NONE = "-"


@dataclass(frozen=True)
class Table:
    """Cells as text; every row has as many as the head."""

    name: str
    """Of its file."""
    caption: str
    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


def tables_of(scores: Sequence[DetectorScores], *, compare_paper: bool) -> tuple[Table, ...]:
    """The paper's two tables, and the rows that it does not have.

    Args:
        scores: One entry for each detector, over the same templates.
        compare_paper: Whether the paper's rows stand below ours.
    """
    paper = list({row.name: row for one in scores for row in paper_rows(one.name)}.values()) if compare_paper else []
    found = [_by_template(scores, paper), _errors(scores, paper), _groups(scores)]
    return tuple(table for table in found if table.rows)


def _by_template(scores: Sequence[DetectorScores], paper: Sequence[PaperDetector]) -> Table:
    templates = list(scores[0].templates)
    rows = [
        (
            one.name,
            *(f"{_3(one.templates[name].mean_average_precision)}/{_3(one.templates[name].nds)}" for name in templates),
            f"{_3(one.mean_ap.value)}/{_3(one.mean_nds)}",
        )
        for one in scores
    ]
    if any(interval.bounded for one in scores for interval in (one.mean_ap, *one.template_ap.values())):
        rows += [
            (f"{one.name}, 95 % of mAP", *(_bounds(one.template_ap[name]) for name in templates), _bounds(one.mean_ap))
            for one in scores
        ]
    for row in paper:
        pairs = [row.ap_and_nds.get(name) for name in (*templates, MEAN)]
        cells = (_NONE if pair is None else f"{_3(pair[0])}/{_3(pair[1])}" for pair in pairs)
        rows.append((f"{row.name} (paper)", *cells))
    caption = "mAP/NDS of the class Car by template, and the mean over the templates"
    return Table("by_template", caption, ("detector", *templates, "mean"), tuple(rows))


def _errors(scores: Sequence[DetectorScores], paper: Sequence[PaperDetector]) -> Table:
    rows = [(one.name, *(f"{one.mean_error(name):.3f}" for name in ERRORS)) for one in scores]
    rows += [(f"{row.name} (paper)", *(f"{row.errors[name]:.3f}" for name in ERRORS)) for row in paper]
    head = ("detector", "ATE m", "ASE", "AOE rad", "AVE m/s", "AAE")
    return Table("errors", "True-positive errors, mean over the templates; lower is better", head, tuple(rows))


def _groups(scores: Sequence[DetectorScores]) -> Table:
    """Rows that the paper does not have: families of templates, and subsets of the labels.

    Detectors may have different subsets: only one that names kinds of vehicles has those found by name.
    """
    rows = [
        ("behaviour family", family, "", *_cells([one.families.get(family, NOTHING) for one in scores]))
        for family in dict.fromkeys(family for one in scores for family in one.families)
    ]
    parts = [{(part.group, part.name): part for part in one.groups} for one in scores]
    for group, name in dict.fromkeys(key for own in parts for key in own):
        found = [own.get((group, name)) for own in parts]
        labels = dict.fromkeys(str(part.labels) for part in found if part is not None)
        if any(part is not None and part.labels for part in found):
            cells = _cells([NOTHING if part is None else part.mean_ap for part in found])
            rows.append((group, name, "/".join(labels), *cells))
    head = ("of", "labels that are", "labels", *(one.name for one in scores))
    caption = "mAP of parts of the labels, with the interval of 95 % over episodes"
    return Table("parts", caption, head, tuple(rows))


def _cells(values: Sequence[Interval]) -> list[str]:
    return [f"{_3(one.value)} {_bounds(one)}" if one.valid else _NONE for one in values]


def _bounds(interval: Interval) -> str:
    return f"{_3(interval.low)}-{_3(interval.high)}" if interval.bounded else f"[{_NONE}]"


def _3(value: float) -> str:
    return f"{value:.3f}".removeprefix("0") if 0.0 <= value < 1.0 else f"{value:.3f}"


def as_text(table: Table) -> list[str]:
    """Lines for a terminal."""
    return [f"{table.caption}:", "", *aligned((table.head, *table.rows))]


def as_csv(table: Table) -> str:
    """The table as CSV with its head."""
    out = io.StringIO()
    csv.writer(out, lineterminator="\n").writerows((table.head, *table.rows))
    return out.getvalue()


def as_latex(table: Table) -> str:
    """The table as LaTeX's ``tabular`` with the rules of ``booktabs``."""
    lines = [
        f"% {table.caption}",
        rf"\begin{{tabular}}{{l{'c' * (len(table.head) - 1)}}}",
        r"\toprule",
        _latex_row(table.head),
        r"\midrule",
        *map(_latex_row, table.rows),
        r"\bottomrule",
        r"\end{tabular}",
    ]
    return "\n".join(lines) + "\n"


def _latex_row(cells: Sequence[str]) -> str:
    escaped = [cell.replace("%", r"\%").replace("_", r"\_").replace("&", r"\&") for cell in cells]
    return " & ".join(escaped) + r" \\"
