"""Tables of the detectors' scores beside the paper's, and all scores as JSON."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, Final

import numpy as np

from siren_ros.base.tables import Bounds, Interval, Row, Table, interval_of_json
from siren_ros.scoring.evaluation.detection.metrics import ERRORS, DevkitScore
from siren_ros.scoring.evaluation.detection.scoring import DetectorScores
from siren_ros.scoring.evaluation.detection.tracking import TrackingScore
from siren_ros.simulation.scenario.paper import TEMPLATES

MEAN: Final = "mean"
_ERROR_TITLES: Final = ("ATE m", "ASE", "AOE rad", "AVE m/s", "AAE")


@dataclass(frozen=True)
class PaperDetector:
    """One detector in the paper's two tables."""

    name: str
    ap_and_nds: Mapping[str, tuple[float, float]]
    """mAP and NDS by template, with the means as printed."""
    errors: Mapping[str, float]
    """True-positive errors, as means over the templates."""


def _paper_row(line: str) -> PaperDetector:
    name, *cells = line.split()
    pairs = [cell.split("/") for cell in cells[: -len(ERRORS)]]
    both = {column: (float(ap), float(nds)) for column, (ap, nds) in zip((*TEMPLATES, MEAN), pairs, strict=True)}
    errors = dict(zip(ERRORS, map(float, cells[-len(ERRORS) :]), strict=True))
    return PaperDetector(name, MappingProxyType(both), MappingProxyType(errors))


_PAPER_ROWS: Final = """
PointPillars .398/.407 .434/.436 .583/.525 .589/.549 .451/.456 .530/.540 .569/.528 .508/.492 .553 .215 .396 3.165 .459
SECOND .420/.420 .388/.438 .631/.563 .633/.574 .461/.480 .523/.540 .590/.556 .521/.510 .565 .214 .207 3.196 .514
VoxelNeXt .438/.393 .413/.434 .641/.571 .616/.558 .468/.454 .568/.540 .578/.543 .532/.499 .562 .216 .313 3.404 .576
TransFusion-L .424/.411 .423/.456 .648/.566 .618/.565 .491/.481 .562/.555 .610/.571 .539/.515 .561 .196 .330 3.223 .461
"""
"""The paper's numbers: mAP/NDS of S1 to S7 and of their mean, then the errors; tables "3D object detection" and
"True-positive error metrics" (supplement)."""
PAPER: Final[Mapping[str, PaperDetector]] = MappingProxyType(
    {row.name.lower(): row for row in map(_paper_row, _PAPER_ROWS.strip().splitlines())}
)
"""The paper's detectors by lower-case name."""


def paper_rows(name: str) -> tuple[PaperDetector, ...]:
    """The paper's row for a detector of that name; all four rows if the paper has no such detector."""
    key = name.lower().replace("_", "-").replace("transfusion-l", "transfusion").replace("transfusion", "transfusion-l")
    return (PAPER[key],) if key in PAPER else tuple(PAPER.values())


def tables_of(content: Mapping[str, Any], *, compare_paper: bool = False) -> tuple[Table, ...]:
    """Tables like the paper's, with the paper's rows below ours on request, and tables that the paper does not have.

    They are made from the content of ``scores.json`` (``scores_as_json``), so that a page of stored scores shows the
    tables of the terminal.
    """
    paper = list({row.name: row for name in content for row in paper_rows(name)}.values()) if compare_paper else []
    tables = (
        *(_by_template(content, paper), _errors(content, paper)),
        *(_people(content), _tracking(content), _errors_by_template(content), _parts(content)),
    )
    return tuple(table for table in tables if table.rows)


def _by_template(content: Mapping[str, Any], paper: Sequence[PaperDetector]) -> Table:
    templates = list(dict.fromkeys(template for scores in content.values() for template in scores["templates"]))
    values: list[Row] = []
    bounds: list[Row] = []
    for name, scores in content.items():
        columns = [*(scores["templates"].get(template) for template in templates), scores["mean"]]
        mean_ap = [interval_of_json(column and column["mAP"]) for column in columns]
        pairs = [column and (ap.value, column["NDS"]) for column, ap in zip(columns, mean_ap, strict=True)]
        values.append((name, *pairs))
        bounds.append((f"{name}, 95 % of mAP", *map(Bounds, mean_ap)))
    some_bounded = any(isinstance(cell, Bounds) and cell.interval.bounded for row in bounds for cell in row)
    names = (*templates, MEAN)
    return Table(
        "by_template",
        "mAP/NDS of the class Car by template, and the mean over the templates",
        ("detector", *names),
        tuple(values + bounds * some_bounded),
        spec=".3f",
        reference=tuple((f"{row.name} (paper)", *map(row.ap_and_nds.get, names)) for row in paper),
    )


def _errors(content: Mapping[str, Any], paper: Sequence[PaperDetector]) -> Table:
    return Table(
        "errors",
        "True-positive errors, mean over the templates; lower is better",
        ("detector", *_ERROR_TITLES),
        tuple(
            (name, *(_mean(score["errors"].get(error) for score in scores["templates"].values()) for error in ERRORS))
            for name, scores in content.items()
        ),
        spec=".3f",
        reference=tuple((f"{row.name} (paper)", *(row.errors[error] for error in ERRORS)) for row in paper),
    )


def _people(content: Mapping[str, Any]) -> Table:
    return Table(
        "people",
        "mAP, with the interval of 95 %, and true-positive errors of people, over all episodes",
        ("detector", "class", "labels", "mAP", *_ERROR_TITLES),
        tuple(
            (name, kind, score["labels"], interval_of_json(score["mAP"]), *map(score["errors"].get, ERRORS))
            for name, scores in content.items()
            for kind, score in scores.get("people", {}).items()
        ),
        spec=".3f",
    )


_TRACKING: Final = MappingProxyType(
    {
        "AMOTA": "AMOTA",
        "AMOTP": "AMOTP m",
        "HOTA": "HOTA",
        "DetA": "DetA",
        "AssA": "AssA",
        "MOTA": "MOTA",
        "switches": "changes of numbers",
        "labels": "labelled tracks",
    }
)
"""Tracking scores: names in ``scores.json`` and in the table."""


def _tracking(content: Mapping[str, Any]) -> Table:
    """Table of tracking scores. Kinds of emergency vehicles have columns of their own, which nuScenes' classes lack."""
    tracking = {name: scores.get("tracking", {}) for name, scores in content.items()}
    classes = list(dict.fromkeys(kind for of_detector in tracking.values() for kind in of_detector))

    def cell(score: Mapping[str, Any] | None, figure: str) -> Any:
        value = score and score[figure]
        return interval_of_json(value) if isinstance(value, dict) else value

    return Table(
        "tracking",
        "Tracks by class, over all episodes: AMOTA, AMOTP and MOTA by nuScenes' code, HOTA, with intervals of 95 %",
        ("detector", "figure", *classes),
        tuple(
            (name, title, *(cell(of_detector.get(kind), figure) for kind in classes))
            for name, of_detector in tracking.items()
            if of_detector
            for figure, title in _TRACKING.items()
        ),
        spec=".3f",
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
            (name, template, *map(score["errors"].get, ERRORS))
            for name, scores in content.items()
            for template, score in scores["templates"].items()
        ),
        spec=".3f",
        folded=True,
    )


def _parts(content: Mapping[str, Any]) -> Table:
    """Table of scores by family of templates and by subset of labels.

    Detectors may have different subsets: only one that names kinds of vehicles has those found by name.
    """
    families = [scores["families"] for scores in content.values()]
    rows: list[Row] = [
        ("behaviour family", name, "", *(interval_of_json(of_detector.get(name)) for of_detector in families))
        for name in dict.fromkeys(name for of_detector in families for name in of_detector)
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
    """All scores by detector; intervals are null where there are too few episodes."""
    return {detector.name: _detector(detector) for detector in scores}


def _detector(scores: DetectorScores) -> dict[str, Any]:
    people = {name: {**_score(of.score), "mAP": _interval(of.mean_ap)} for name, of in scores.people.items()}
    tracking = {name: _tracked(score) for name, score in scores.tracking.items()}
    return {
        "format": scores.format,
        "velocity_known": scores.has_velocity,
        "mean": {"mAP": _interval(scores.mean_ap), "NDS": scores.mean_nds},
        "templates": {
            name: {"frames": scores.frames[name], **_score(score), "mAP": _interval(scores.template_ap[name])}
            for name, score in scores.templates.items()
        },
        **({"people": people} if people else {}),
        **({"tracking": tracking} if tracking else {}),
        **({"seen": {split.value: count for split, count in scores.seen.items()}} if scores.seen else {}),
        "families": {name: _interval(value) for name, value in scores.families.items()},
        "order_of_families_share": None if scores.order is None else scores.order.whole,
        "order_of_families_steps": None if scores.order is None else dict(scores.order.steps),
        "parts": [
            {"of": part.group, "name": part.name, "labels": part.labels, "mAP": _interval(part.mean_ap)}
            for part in scores.groups
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


def _tracked(score: TrackingScore) -> Mapping[str, Any]:
    return {
        "AMOTA": _interval(score.amota),
        "AMOTP": _interval(score.amotp_m),
        "HOTA": _interval(score.hota),
        "DetA": score.detection,
        "AssA": score.association,
        "MOTA": score.devkit.mota,
        "switches": None if np.isnan(score.devkit.switches) else int(score.devkit.switches),
        "labels": score.devkit.labels,
        "confidence": score.devkit.confidence,
    }


def _interval(value: Interval) -> dict[str, Any] | None:
    return value.json() if value.valid else None
