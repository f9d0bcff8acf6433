"""Everything as JSON types; null where there is no value."""

from collections.abc import Sequence
from typing import Any

from siren_ros.evaluation.prediction.metrics.calibration import calibration_error
from siren_ros.evaluation.prediction.metrics.metric import MetricValue
from siren_ros.evaluation.prediction.metrics.table import METRICS
from siren_ros.evaluation.prediction.protocol.window import future_times_s
from siren_ros.evaluation.prediction.reports.differences import Difference
from siren_ros.evaluation.prediction.reports.paper_comparison import compare_with_paper
from siren_ros.evaluation.prediction.reports.paper_results import paper_value
from siren_ros.evaluation.prediction.reports.score_table import Cell, ScoreTable
from siren_ros.evaluation.prediction.scoring.episode_scores import EpisodeScores
from siren_ros.evaluation.statistics.interval import CONFIDENCE, Interval


def json_report(table: ScoreTable, found: Sequence[Difference]) -> dict[str, Any]:
    """The whole evaluation."""
    return {
        "task": "prediction",
        "population": table.episodes[0].population.value,
        "intervals": {"confidence": CONFIDENCE, "method": "jackknife", "block": "episode", "stratum": "template"},
        "episodes": [_episode(episode) for episode in table.episodes],
        "models": {model: _model(table, model) for model in table.models},
        "differences": [_difference(one) for one in found],
    }


def _episode(episode: EpisodeScores) -> dict[str, Any]:
    return {
        "name": episode.name,
        "template": episode.template,
        "level": episode.level.name,
        "seed": episode.seed,
        "map": episode.map_name,
        "parameters": dict(episode.parameters),
        "models": {
            model: {
                "samples": len(scores),
                "wanted": scores.wanted,
                **{metric.name: _known(scores[metric.name]) for metric in METRICS},
                "paper": {
                    metric.name: known
                    for metric in METRICS
                    if (known := paper_value(model, metric.name, episode.template)) is not None
                },
            }
            for model, scores in episode.models.items()
        },
    }


def _model(table: ScoreTable, model: str) -> dict[str, Any]:
    samples = table.samples[model]
    rows: dict[str, dict[str, dict[str, Any]]] = {}
    for group in table.groups:
        cells = {one.name: table.cells.get((model, group.name, one.name)) for one in METRICS}
        rows.setdefault(group.kind.value, {})[group.name] = {
            name: _cell(cell) for name, cell in cells.items() if cell is not None
        }
    compared = {one.name: compare_with_paper(table, model, one.name) for one in METRICS}
    return {
        "samples": len(samples),
        "wanted": samples.wanted,
        "coverage": samples.coverage,
        "calibration_error": _known(calibration_error(samples.reliability)),
        "distance_over_time_m": {
            f"{time_s:.1f}": float(total) / len(samples)
            for time_s, total in zip(future_times_s(), samples.distance_sum_m, strict=True)
            if len(samples)
        },
        "rows": rows,
        "paper": {
            name: {**vars(one), "ranking": None if one.ranking is None else vars(one.ranking)}
            for name, one in compared.items()
            if one is not None
        },
    }


def _difference(one: Difference) -> dict[str, Any]:
    return {
        "metric": one.metric,
        "name": one.group,
        "first": one.first,
        "second": one.second,
        **_interval(one.difference),
        "p": one.p_value,
        "p_holm": one.adjusted_p_value,
        "samples": one.samples,
    }


def _cell(cell: Cell) -> dict[str, Any]:
    return {**_interval(cell.interval), "samples": cell.samples, "episodes": cell.interval.blocks}


def _interval(found: Interval) -> dict[str, Any]:
    return {
        "value": found.value if found.valid else None,
        "low": found.low if found.bounded else None,
        "high": found.high if found.bounded else None,
    }


def _known(value: MetricValue) -> float | None:
    return value.value if value.valid else None
