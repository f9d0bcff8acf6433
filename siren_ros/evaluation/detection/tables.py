"""Tables of the detectors' scores next to the paper's, and all scores as JSON."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, Final

import numpy as np

from siren_ros.evaluation.detection.devkit_score import ERRORS, DevkitScore
from siren_ros.evaluation.detection.scoring import DetectorScores
from siren_ros.scenario.paper import TEMPLATES
from siren_ros.tables.interval import Bounds, Interval, interval_of_json
from siren_ros.tables.table import Row, Table

MEAN: Final = "mean"
_ERROR_TITLES: Final = ("ATE m", "ASE", "AOE rad", "AVE m/s", "AAE")


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
    both = {column: (cell[0], cell[1]) for column, cell in zip((*TEMPLATES, MEAN), cells, strict=True)}
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


def tables_of(content: Mapping[str, Any], *, compare_paper: bool = False) -> tuple[Table, ...]:
    """The paper's two tables, and those that the paper does not have.

    They are made from the content of ``scores.json``, so that a page of stored scores shows the tables of the terminal.

    Args:
        content: As ``scores_as_json`` makes it.
        compare_paper: Whether the paper's rows stand below ours.
    """
    paper = list({row.name: row for name in content for row in paper_rows(name)}.values()) if compare_paper else []
    tables = [_by_template(content, paper), _errors(content, paper), _errors_by_template(content), _parts(content)]
    return tuple(table for table in tables if table.rows)


def _by_template(content: Mapping[str, Any], paper: Sequence[PaperDetector]) -> Table:
    templates = list(dict.fromkeys(template for scores in content.values() for template in scores["templates"]))
    values: list[Row] = []
    bounds: list[Row] = []
    for name, scores in content.items():
        columns = [*(scores["templates"].get(template) for template in templates), scores["mean"]]
        mean_ap = [interval_of_json(column and column["mAP"]) for column in columns]
        pairs = [column and (one.value, column["NDS"]) for column, one in zip(columns, mean_ap, strict=True)]
        values.append((name, *pairs))
        bounds.append((f"{name}, 95 % of mAP", *map(Bounds, mean_ap)))
    some_bounded = any(isinstance(cell, Bounds) and cell.interval.bounded for row in bounds for cell in row)
    return Table(
        "by_template",
        "mAP/NDS of the class Car by template, and the mean over the templates",
        ("detector", *templates, MEAN),
        tuple(values + bounds * some_bounded),
        spec=".3f",
        reference=tuple(
            (f"{row.name} (paper)", *(row.ap_and_nds.get(name) for name in (*templates, MEAN))) for row in paper
        ),
    )


def _errors(content: Mapping[str, Any], paper: Sequence[PaperDetector]) -> Table:
    errors = {name: [one["errors"] for one in scores["templates"].values()] for name, scores in content.items()}
    return Table(
        "errors",
        "True-positive errors, mean over the templates; lower is better",
        ("detector", *_ERROR_TITLES),
        tuple(
            (name, *(_mean(one.get(error) for one in of_templates) for error in ERRORS))
            for name, of_templates in errors.items()
        ),
        spec=".3f",
        reference=tuple((f"{row.name} (paper)", *(row.errors[error] for error in ERRORS)) for row in paper),
    )


def _mean(values: Iterable[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return float(np.mean(known)) if known else None


def _errors_by_template(content: Mapping[str, Any]) -> Table:
    return Table(
        "errors_by_template",
        "True-positive errors by template",
        ("detector", "template", *_ERROR_TITLES),
        tuple(
            (name, template, *(one["errors"].get(error) for error in ERRORS))
            for name, scores in content.items()
            for template, one in scores["templates"].items()
        ),
        spec=".3f",
        folded=True,
    )


def _parts(content: Mapping[str, Any]) -> Table:
    """Families of templates, and subsets of the labels.

    Detectors may have different subsets: only one that names kinds of vehicles has those found by name.
    """
    families = dict.fromkeys(family for scores in content.values() for family in scores["families"])
    rows: list[Row] = [
        ("behaviour family", family, "", *(interval_of_json(one["families"].get(family)) for one in content.values()))
        for family in families
    ]
    parts = [{(part["of"], part["name"]): part for part in scores["parts"]} for scores in content.values()]
    for key in dict.fromkeys(key for of_detector in parts for key in of_detector):
        of_detectors = [of_detector.get(key) for of_detector in parts]
        labels = dict.fromkeys(part["labels"] for part in of_detectors if part)
        if any(labels):
            rows.append((*key, tuple(labels), *(interval_of_json(part and part["mAP"]) for part in of_detectors)))
    return Table(
        "parts",
        "mAP of parts of the labels, with the interval of 95 % over episodes",
        ("of", "labels that are", "labels", *content),
        tuple(rows),
        spec=".3f",
        folded=True,
    )


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
    return value.json() if value.valid else None
