"""Section: trajectory prediction on the bags."""

from collections.abc import Iterator
from typing import Final

from siren_ros.evaluation.prediction.charts.horizon import draw_horizon
from siren_ros.evaluation.prediction.metrics.table import METRICS
from siren_ros.evaluation.prediction.reports.groups import GroupKind
from siren_ros.evaluation.prediction.reports.score_table import ScoreTable
from siren_ros.evaluation.prediction.reports.text_report import POPULATION_TEXT
from siren_ros.study_report.cells import number, pair, with_interval
from siren_ros.study_report.commands import command
from siren_ros.study_report.content import Figure, Section, Table
from siren_ros.study_report.inlined import figure_uri
from siren_ros.study_report.study_rows import StudyRows

_SHOWN: Final = ("ade_m", "fde_m")
_ALL: Final = GroupKind.ALL.value


def prediction_section(study: StudyRows, scores: ScoreTable) -> Section:
    """How well models predict where vehicles go."""
    text = (
        "Three seconds of history, five of future every 0.2 s, a sample for each vehicle and each frame at 10 Hz; "
        f"{POPULATION_TEXT[scores.episodes[0].population]}. A mean over templates counts each of them once; intervals "
        "are 95 % over whole episodes."
    )
    figures = (Figure("horizon", "Error over the horizon", figure_uri(draw_horizon(scores))),)
    models = ",".join(scores.models)
    return Section(
        "prediction",
        "Task: trajectory prediction",
        (text,),
        figures,
        tables=tuple(_tables(scores)),
        commands=(command("evaluate prediction", study.folder, f"--models {models} --out prediction"),),
    )


def _tables(scores: ScoreTable) -> Iterator[Table]:
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
