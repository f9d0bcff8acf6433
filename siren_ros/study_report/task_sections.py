"""Sections of the page about the tasks: prediction, detection, risk, and all of them next to the paper."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

from siren_ros.evaluation.detection.devkit_score import ERRORS
from siren_ros.evaluation.paper_comparison import (
    Compared,
    detection_rows,
    interval_in,
    measured,
    own_level_only,
    prediction_rows,
    risk_rows,
    stored,
)
from siren_ros.evaluation.prediction.charts import draw_horizon
from siren_ros.evaluation.prediction.metrics import METRICS
from siren_ros.evaluation.prediction.reports.paper_results import PAPER_NAMES, maps_next_to_the_papers
from siren_ros.evaluation.prediction.reports.score_table import GroupKind, ScoreTable, score_table
from siren_ros.evaluation.prediction.reports.text_report import POPULATION_TEXT
from siren_ros.evaluation.statistics.interval import NOTHING, Interval
from siren_ros.study_report.episode_sections import own_level
from siren_ros.study_report.page import (
    NONE,
    Picture,
    Section,
    Table,
    command,
    figure_uri,
    number,
    pair,
    quoted,
    with_interval,
)
from siren_ros.study_report.page import number as number_of
from siren_ros.study_report.study import PageOptions, StudyMeasures, StudyRows, stored_tables

_SHOWN: Final = ("ade_m", "fde_m")
_ALL: Final = GroupKind.ALL.value


def prediction_section(study: StudyRows, scores: ScoreTable) -> Section:
    """How well models predict where vehicles go."""
    text = (
        "Three seconds of history, five of future every 0.2 s, a sample for each vehicle and each frame at 10 Hz; "
        f"{POPULATION_TEXT[scores.episodes[0].population]}. A mean over templates counts each of them once; intervals "
        "are 95 % over whole episodes."
    )
    figures = (Picture("horizon", "Error over the horizon", figure_uri(draw_horizon(scores))),)
    models = ",".join(scores.models)
    return Section(
        "prediction",
        "Task: trajectory prediction",
        (text,),
        figures,
        tables=tuple(_prediction_tables(scores)),
        commands=(command("evaluate prediction", study.folder, f"--models {models} --out prediction"),),
    )


def _prediction_tables(scores: ScoreTable) -> Iterator[Table]:
    templates = [group.name for group in scores.of_kind(GroupKind.TEMPLATE)]
    rows = [
        (
            model,
            *(pair([scores.value(model, name, metric) for metric in _SHOWN]) for name in templates),
            pair([scores.value(model, _ALL, metric) for metric in _SHOWN]),
            with_interval(scores.cells[model, _ALL, _SHOWN[0]].interval),
            f"{len(scores.samples[model]):,}",
        )
        for model in scores.models
    ]
    head = ("model", *templates, "mean", "ADE with interval", "samples")
    yield Table("prediction_templates", "ADE/FDE in m by template", head, tuple(rows))
    rows = [(model, *(number(scores.value(model, _ALL, metric.name)) for metric in METRICS)) for model in scores.models]
    head = ("model", *(metric.label for metric in METRICS))
    yield Table("prediction_metrics", "All metrics, mean over the templates", head, tuple(rows))
    for kind in (GroupKind.LEVEL, GroupKind.CATEGORY):
        groups = [group.name for group in scores.of_kind(kind)]
        rows = [
            (name, *(with_interval(scores.cells[model, name, _SHOWN[0]].interval) for model in scores.models))
            for name in groups
        ]
        yield Table(f"prediction_{kind.value}", f"ADE in m by {kind.value}", (kind.value, *scores.models), tuple(rows))


def detection_section(study: StudyRows, folder: Path) -> Section | None:
    """The detectors' scores; None where there are none."""
    tables = stored_tables("detection", folder, _detection_tables)
    if tables is None:
        return None
    text = (
        "nuScenes' own code and the paper's protocol: one class for all vehicles, labels within 50 m with at least one "
        "LiDAR point. Intervals are 95 % over episodes."
    )
    call = command("evaluate detection", study.folder, f"--detections NAME=FILE --out {quoted(folder)}")
    return Section("detection", "Task: 3-D detection", (text,), tables=tables, commands=(call,))


def _detection_tables(content: Mapping[str, Any]) -> Iterator[Table]:
    templates = list(dict.fromkeys(name for one in content.values() for name in one["templates"]))
    rows = [
        (
            name,
            *(_ap_nds(one["templates"].get(template)) for template in templates),
            f"{with_interval(interval_in(one['mean']['mAP']), 3)} / {number(one['mean']['NDS'], 3)}",
        )
        for name, one in content.items()
    ]
    yield Table("detection_templates", "mAP / NDS by template", ("detector", *templates, "mean"), tuple(rows))
    rows = [
        (name, template, *(number(of_template["errors"].get(error), 3) for error in ERRORS))
        for name, one in content.items()
        for template, of_template in one["templates"].items()
    ]
    head = ("detector", "template", *ERRORS)
    yield Table("detection_errors", "True-positive errors", head, tuple(rows), folded=True)
    rows = [
        (name, part["of"], part["name"], f"{part['labels']:,}", with_interval(interval_in(part["mAP"]), 3))
        for name, one in content.items()
        for part in one["parts"]
        if part["labels"]
    ]
    if rows:
        head = ("detector", "of", "labels that are", "labels", "mAP")
        yield Table("detection_parts", "mAP of parts of the labels", head, tuple(rows), folded=True)


def _ap_nds(found: Mapping[str, Any] | None) -> str:
    if found is None:
        return number(None)
    return f"{number(interval_in(found['mAP']).value, 3)} / {number(found['NDS'], 3)}"


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
    tables = stored_tables("risk", folder, _risk_tables)
    if tables is None:
        return None
    text = (
        "Each video is normal, a near-miss or a collision. Values are percentages, intervals 95 % over "
        "videos. The rows majority and oracle answer the commonest class and the label itself."
    )
    call = f"./env siren evaluate risk SET --predictions NAME=FILE --out {quoted(folder)}"
    return Section("risk", "Task: risk understanding", (text,), tables=tables, commands=(call,))


def _risk_tables(content: Mapping[str, Any]) -> Iterator[Table]:
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


def paper_section(study: StudyRows, measures: StudyMeasures, options: PageOptions) -> Section | None:
    """The paper's numbers that were measured here; None without an episode at its template's own level."""
    counted = own_level_only(measures.prediction, own_level)
    if not counted:
        return None
    detection, risk = options.detection_in(study.folder), options.risk_in(study.folder)
    rows = measured(
        [
            *prediction_rows(score_table(counted)),
            *detection_rows(stored(detection)),
            *risk_rows(None, stored(risk)),
        ]
    )
    text = (
        f"Of the {len(measures.bags)} episodes, {len(counted)} are at their template's own level and count here, as in "
        "the paper, which has one episode of each template. Samples are of the vehicles in the interaction region; "
        f"{maps_next_to_the_papers(counted)}. "
        "Intervals are 95 % over episodes; a star says that the paper's value lies in ours."
    )
    more = [
        f"--{name} {quoted(folder)}"
        for name, folder in (("detection", detection), ("risk", risk))
        if stored(folder) is not None
    ]
    models = ",".join(name for name in options.models if name in PAPER_NAMES)
    call = command("compare-paper", study.folder, f"--models {models}", *more)
    return Section(
        "next_to_the_paper", "Next to the paper", (text,), tables=tuple(_paper_tables(rows)), commands=(call,)
    )


def _paper_tables(rows: Sequence[Compared]) -> Iterator[Table]:
    """A table for each of the paper's: two rows for each of its rows, the paper's and ours."""
    for place, name in enumerate(dict.fromkeys(row.table for row in rows)):
        of_table = [row for row in rows if row.table == name]
        columns = list(dict.fromkeys(row.column for row in of_table))
        lines = []
        for model in dict.fromkeys(row.row for row in of_table):
            cells = {row.column: row for row in of_table if row.row == model}
            there = [cells.get(column) for column in columns]
            lines.append((f"{model}, paper", *(number_of(one.paper, one.digits) if one else NONE for one in there)))
            lines.append((f"{model}, here", *(_ours(one) if one else NONE for one in there)))
        yield Table(f"paper_{place}", _capitalised(name), ("", *columns), tuple(lines))


def _capitalised(name: str) -> str:
    """With a capital, where the first word has none anyway: not ``MAP`` for ``mAP``."""
    return f"{name[:1].upper()}{name[1:]}" if name.partition(" ")[0].islower() else name


def _ours(row: Compared) -> str:
    return with_interval(row.ours, row.digits) + (" *" if row.inside else "")
