"""Tables of the detectors' scores next to the paper's, and all scores as JSON."""

import csv
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, Final

from siren_ros.evaluation.aligned_text import aligned
from siren_ros.evaluation.detection.devkit_score import ERRORS, DevkitScore
from siren_ros.evaluation.detection.scoring import DetectorScores
from siren_ros.evaluation.statistics.interval import NOTHING, Interval

PAPER_TEMPLATES: Final = ("S1", "S2", "S3", "S4", "S5", "S6", "S7")
MEAN: Final = "mean"


@dataclass(frozen=True)
class PaperDetector:
    """One row of each of the paper's two tables."""

    name: str
    ap_and_nds: Mapping[str, tuple[float, float]]
    """mAP and NDS by template, and their means as printed."""
    errors: Mapping[str, float]
    """True-positive errors, mean over the templates."""


def _row(name: str, pairs: str, errors: str) -> PaperDetector:
    cells = [tuple(map(float, pair.split("/"))) for pair in pairs.split()]
    both = {column: (cell[0], cell[1]) for column, cell in zip((*PAPER_TEMPLATES, MEAN), cells, strict=True)}
    values = dict(zip(ERRORS, map(float, errors.split()), strict=True))
    return PaperDetector(name, MappingProxyType(both), MappingProxyType(values))


PAPER: Final[Mapping[str, PaperDetector]] = MappingProxyType(
    {
        "pointpillars": _row(
            "PointPillars",
            ".398/.407 .434/.436 .583/.525 .589/.549 .451/.456 .530/.540 .569/.528 .508/.492",
            "0.553 0.215 0.396 3.165 0.459",
        ),
        "second": _row(
            "SECOND",
            ".420/.420 .388/.438 .631/.563 .633/.574 .461/.480 .523/.540 .590/.556 .521/.510",
            "0.565 0.214 0.207 3.196 0.514",
        ),
        "voxelnext": _row(
            "VoxelNeXt",
            ".438/.393 .413/.434 .641/.571 .616/.558 .468/.454 .568/.540 .578/.543 .532/.499",
            "0.562 0.216 0.313 3.404 0.576",
        ),
        "transfusion-l": _row(
            "TransFusion-L",
            ".424/.411 .423/.456 .648/.566 .618/.565 .491/.481 .562/.555 .610/.571 .539/.515",
            "0.561 0.196 0.330 3.223 0.461",
        ),
    }
)
"""By lower-case name: tables "3D object detection" and "True-positive error metrics" (supplement)."""


def paper_rows(name: str) -> tuple[PaperDetector, ...]:
    """The paper's row for a detector of that name; all four for a detector that the paper does not have."""
    key = name.lower().replace("_", "-").replace("transfusion-l", "transfusion").replace("transfusion", "transfusion-l")
    return (PAPER[key],) if key in PAPER else tuple(PAPER.values())


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


def scores_as_json(scores: Sequence[DetectorScores]) -> dict[str, Any]:
    """By the detectors' names; intervals are null where there are too few episodes."""
    return {one.name: _detector(one) for one in scores}


def _detector(one: DetectorScores) -> dict[str, Any]:
    return {
        "format": one.format,
        "velocity_known": one.has_velocity,
        "mean": {"mAP": _interval(one.mean_ap), "NDS": one.mean_nds},
        "templates": {
            name: {"frames": one.frames[name], **_score(score), "mAP": _interval(one.template_ap[name])}
            for name, score in one.templates.items()
        },
        "families": {name: _interval(value) for name, value in one.families.items()},
        "order_of_families_share": None if one.order is None else one.order.whole,
        "order_of_families_steps": None if one.order is None else dict(one.order.steps),
        "parts": [
            {"of": part.group, "name": part.name, "labels": part.labels, "mAP": _interval(part.mean_ap)}
            for part in one.groups
        ],
    }


def _score(score: DevkitScore) -> Mapping[str, Any]:
    return {
        "labels": score.labels,
        "detections": score.detections,
        "NDS": score.nds,
        "AP": {f"{distance_m:g}": value for distance_m, value in score.average_precision.items()},
        "errors": dict(score.errors),
        "precision_at_recall_0_to_1": score.precision.round(6).tolist(),
    }


def _interval(value: Interval) -> dict[str, Any] | None:
    if not value.valid:
        return None
    bounds = (value.low, value.high) if value.bounded else (None, None)
    return {"value": value.value, "low": bounds[0], "high": bounds[1], "episodes": value.blocks}
