"""Tables of the detectors' scores beside the paper's, and all scores as JSON."""

from collections.abc import Iterator, Mapping, Sequence
from types import MappingProxyType
from typing import Any, Final

from siren_ros.base.tables import Bounds, Cell, Row, Table
from siren_ros.scoring.evaluation.detection.metrics import ERRORS, DevkitScore
from siren_ros.scoring.evaluation.detection.scoring import MEAN_AP, DetectorScores
from siren_ros.scoring.evaluation.scores import ALL, TEMPLATE, Scores
from siren_ros.simulation.scenario.paper import TEMPLATES

_ERROR_TITLES: Final = ("ATE m", "ASE", "AOE rad", "AVE m/s", "AAE")


_PAPER_ROWS: Final = """
PointPillars .398/.407 .434/.436 .583/.525 .589/.549 .451/.456 .530/.540 .569/.528 .508/.492 .553 .215 .396 3.165 .459
SECOND .420/.420 .388/.438 .631/.563 .633/.574 .461/.480 .523/.540 .590/.556 .521/.510 .565 .214 .207 3.196 .514
VoxelNeXt .438/.393 .413/.434 .641/.571 .616/.558 .468/.454 .568/.540 .578/.543 .532/.499 .562 .216 .313 3.404 .576
TransFusion-L .424/.411 .423/.456 .648/.566 .618/.565 .491/.481 .562/.555 .610/.571 .539/.515 .561 .196 .330 3.223 .461
"""
"""The paper's numbers: mAP/NDS of S1 to S7 and of their mean, then the errors; tables "3D object detection" and
"True-positive error metrics" (supplement)."""
PaperRow = Mapping[tuple[str, str], float]
"""Values by metric, and template or ``all``, which is the mean as printed; errors are means."""


def _read() -> Iterator[tuple[str, PaperRow]]:
    pairs = [(metric, group) for group in (*TEMPLATES, ALL) for metric in (MEAN_AP, "NDS")]
    for line in _PAPER_ROWS.strip().splitlines():
        name, *values = line.replace("/", " ").split()
        columns = (*pairs, *((error, ALL) for error in ERRORS))
        yield name, MappingProxyType(dict(zip(columns, map(float, values), strict=True)))


PAPER: Final[Mapping[str, PaperRow]] = MappingProxyType(dict(_read()))
"""The paper's detectors by name."""


def papers_of(name: str) -> tuple[str, ...]:
    """Name of the paper's detector of that name; all four if the paper has no such detector."""
    key = name.lower().replace("_", "-").replace("transfusion-l", "transfusion").replace("transfusion", "transfusion-l")
    return tuple(paper for paper in PAPER if paper.lower() == key) or tuple(PAPER)


def tables_of(content: Mapping[str, Any], *, compare_paper: bool = False) -> tuple[Table, ...]:
    """Tables like the paper's, with the paper's rows below ours on request, and tables that the paper does not have.

    They are made from the content of ``scores.json`` (``scores_as_json``), so that a page of stored scores shows the
    tables of the terminal.
    """
    scores = Scores.of_json(content)
    paper = list(dict.fromkeys(name for model in scores.models * compare_paper for name in papers_of(model)))
    tables = (
        *(_by_template(scores, paper), _errors(scores, paper)),
        *(_people(scores), _tracking(scores), _errors_by_template(scores), _parts(scores)),
    )
    return tuple(table for table in tables if table.rows)


def _by_template(scores: Scores, paper: Sequence[str]) -> Table:
    groups = (*scores.groups(TEMPLATE), (ALL, ALL))
    values: list[Row] = []
    bounds: list[Row] = []
    for model in scores.models:
        pairs = ([scores.value(model, *group, metric) for metric in (MEAN_AP, "NDS")] for group in groups)
        values.append((model, *(None if pair[0] is None else tuple(pair) for pair in pairs)))
        mean_ap = (scores.interval(model, *group, MEAN_AP) for group in groups)
        bounds.append((f"{model}, 95 % of mAP", *map(Bounds, mean_ap)))
    some_bounded = any(isinstance(cell, Bounds) and cell.interval.bounded for row in bounds for cell in row)
    names = (*(name for _, name in groups[:-1]), "mean")
    return Table(
        "by_template",
        "mAP/NDS of the class Car by template, and the mean over the templates",
        ("detector", *names),
        tuple(values + bounds * some_bounded),
        spec=".3f",
        reference=tuple(
            (f"{name} (paper)", *(_paper_pair(PAPER[name], group) for _, group in groups)) for name in paper
        ),
    )


def _paper_pair(row: PaperRow, group: str) -> tuple[float, float] | None:
    return (row[MEAN_AP, group], row["NDS", group]) if (MEAN_AP, group) in row else None


def _errors(scores: Scores, paper: Sequence[str]) -> Table:
    return Table(
        "errors",
        "True-positive errors, mean over the templates; lower is better",
        ("detector", *_ERROR_TITLES),
        tuple((model, *_errors_of(scores, model, ALL, ALL)) for model in scores.models),
        spec=".3f",
        reference=tuple((f"{name} (paper)", *(PAPER[name][error, ALL] for error in ERRORS)) for name in paper),
    )


def _errors_of(scores: Scores, model: str, kind: str, group: str) -> Iterator[float | None]:
    return (scores.value(model, kind, group, error) for error in ERRORS)


def _people(scores: Scores) -> Table:
    rows = [row for row in scores.rows if (row.kind, row.metric) == ("people", MEAN_AP)]
    return Table(
        "people",
        "mAP, with the interval of 95 %, and true-positive errors of people, over all episodes",
        ("detector", "class", "labels", "mAP", *_ERROR_TITLES),
        tuple(
            (row.model, row.group, row.samples, row.interval, *_errors_of(scores, row.model, row.kind, row.group))
            for row in rows
        ),
        spec=".3f",
    )


_TRACKING: Final = ("AMOTA", "AMOTP", "HOTA", "DetA", "AssA", "MOTA", "switches", "labels")
"""Rows of the table of tracks: metrics, and ``labels``, which are their samples."""
_TRACKING_TITLES: Final = {"AMOTP": "AMOTP m", "switches": "changes of numbers", "labels": "labelled tracks"}


def _tracking(scores: Scores) -> Table:
    """Table of tracking scores. Kinds of emergency vehicles have columns of their own, which nuScenes' classes lack."""
    groups = scores.groups("tracking")

    def cell(model: str, group: tuple[str, str], figure: str) -> Cell:
        row = scores.by_place.get((model, *group, "AMOTA" if figure == "labels" else figure))
        if row is None or row.value is None:
            return None
        if figure in {"labels", "switches"}:
            return row.samples if figure == "labels" else int(row.value)
        return row.interval if figure in {"AMOTA", "AMOTP", "HOTA"} else row.value

    return Table(
        "tracking",
        "Tracks by class, over all episodes: AMOTA, AMOTP and MOTA by nuScenes' code, HOTA, with intervals of 95 %",
        ("detector", "figure", *(name for _, name in groups)),
        tuple(
            (model, _TRACKING_TITLES.get(figure, figure), *(cell(model, group, figure) for group in groups))
            for model in scores.models
            if any((model, *group, "AMOTA") in scores.by_place for group in groups)
            for figure in _TRACKING
        ),
        spec=".3f",
    )


def _errors_by_template(scores: Scores) -> Table:
    return Table(
        "errors_by_template",
        "True-positive errors by template",
        ("detector", "template", *_ERROR_TITLES),
        tuple(
            (row.model, row.group, *_errors_of(scores, row.model, row.kind, row.group))
            for row in scores.rows
            if (row.kind, row.metric) == (TEMPLATE, MEAN_AP)
        ),
        spec=".3f",
        folded=True,
    )


_NO_PARTS: Final = frozenset({ALL, TEMPLATE, "people", "family", "order", "tracking"})


def _parts(scores: Scores) -> Table:
    """Table of scores by family of templates and by subset of labels.

    Detectors may have different subsets: only one that names kinds of vehicles has those found by name.
    """
    rows: list[Row] = [
        ("behaviour family", name, "", *(scores.interval(model, "family", name, MEAN_AP) for model in scores.models))
        for _, name in scores.groups("family")
    ]
    for group in (group for group in scores.groups() if group[0] not in _NO_PARTS):
        found = [scores.by_place.get((model, *group, MEAN_AP)) for model in scores.models]
        labels = dict.fromkeys(row.samples for row in found if row)
        if any(labels):
            rows.append((*group, tuple(labels), *(row.interval if row else None for row in found)))
    return Table(
        "parts",
        "mAP of parts of the labels, with the interval of 95 % over episodes",
        ("of", "labels that are", "labels", *scores.models),
        tuple(rows),
        spec=".3f",
        folded=True,
    )


def scores_as_json(scores: Sequence[DetectorScores]) -> dict[str, Any]:
    """Rows of scores, and what is no row, by detector."""
    rows = [row.json() for detector in scores for row in detector.rows]
    return {"task": "detection", "rows": rows, "models": {detector.name: _detector(detector) for detector in scores}}


def _detector(scores: DetectorScores) -> dict[str, Any]:
    return {
        "format": scores.format,
        "velocity_known": scores.has_velocity,
        "frames": dict(scores.frames),
        **({"seen": {split.value: count for split, count in scores.seen.items()}} if scores.seen else {}),
        "curves": {name: _curves(score) for name, score in {**scores.templates, **scores.people}.items()},
    }


def _curves(score: DevkitScore) -> dict[str, Any]:
    return {
        "labels": score.labels,
        "detections": score.detections,
        "AP": {f"{distance_m:g}": value for distance_m, value in score.average_precision.items()},
        "precision_at_recall_0_to_1": score.precision.round(6).tolist(),
    }
