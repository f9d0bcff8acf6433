"""The files of a report: CSV, JSON, and LaTeX tables like the paper's."""

import json
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

from siren_ros.errors import whole_file, writing
from siren_ros.evaluation.prediction.episode_scores import EpisodeScores
from siren_ros.evaluation.prediction.metrics import BINS, METRICS, calibration_error
from siren_ros.evaluation.prediction.predictors import LABEL
from siren_ros.evaluation.prediction.reports.paper_results import (
    PAPER_NAMES,
    compare_with_paper,
    paper_row,
    paper_value,
)
from siren_ros.evaluation.prediction.reports.score_table import Difference, GroupKind, ScoreTable
from siren_ros.evaluation.prediction.reports.tables import BY_TEMPLATE
from siren_ros.evaluation.prediction.samples import future_times_s
from siren_ros.tables.interval import CONFIDENCE
from siren_ros.tables.table import Table, csv_text

_CSV_HEADS: Final = {
    "scores": ("model", "rows", "name", "metric", "value", "low", "high", "samples", "episodes", "paper"),
    "episodes": ("episode", "template", "level", "seed", "map", "model", "metric", "value", "samples"),
    "differences": ("metric", "name", "first", "second", "difference", "low", "high", "p", "p_holm", "samples"),
    "horizon": ("model", "time_s", "distance_m"),
    "calibration": ("model", "from", "to", "hypotheses", "mean_probability", "share_best"),
}


def csv_files(table: ScoreTable, pairs: Sequence[Difference]) -> dict[str, str]:
    """Content by file name: one line for each value, so that any program can make its own tables of them."""
    rows = (_scores(table), _episodes(table), _differences(pairs), _horizon(table), _calibration(table))
    return {f"{name}.csv": csv_text(head, lines) for (name, head), lines in zip(_CSV_HEADS.items(), rows, strict=True)}


def _scores(table: ScoreTable) -> Iterable[Sequence[object]]:
    kinds = {group.name: group.kind for group in table.groups}
    for (model, group, metric), cell in table.cells.items():
        row = paper_row(model, metric)
        paper = None if row is None else row.mean if kinds[group] is GroupKind.ALL else row.by_template.get(group)
        value, low, high, blocks = cell.interval.json().values()
        yield model, kinds[group].value, group, metric, value, low, high, cell.samples, blocks, paper


def _episodes(table: ScoreTable) -> Iterable[Sequence[object]]:
    for episode in table.episodes:
        head = (episode.name, episode.template, episode.level.name, episode.seed, episode.map_name)
        for model, scores in episode.models.items():
            for metric in METRICS:
                value = scores[metric.name]
                yield *head, model, metric.name, value.known, value.samples


def _differences(pairs: Sequence[Difference]) -> Iterable[Sequence[object]]:
    for each in pairs:
        value, low, high, _ = each.difference.json().values()
        head = (each.metric, each.group, each.first, each.second)
        yield *head, value, low, high, each.p_value, each.adjusted_p_value, each.samples


def _horizon(table: ScoreTable) -> Iterable[Sequence[object]]:
    for model, samples in table.samples.items():
        if len(samples):
            for time_s, total in zip(future_times_s(), samples.distance_sum_m, strict=True):
                yield model, f"{time_s:.1f}", total / len(samples)


def _calibration(table: ScoreTable) -> Iterable[Sequence[object]]:
    for model, samples in table.samples.items():
        counts = samples.reliability
        for place, count in enumerate(counts.count.tolist()):
            if count:
                shares = counts.probability[place] / count, counts.best[place] / count
                yield model, place / BINS, (place + 1) / BINS, int(count), *shares


def json_report(table: ScoreTable, pairs: Sequence[Difference]) -> dict[str, Any]:
    """The whole evaluation as JSON types; null where there is no value."""
    return {
        "task": "prediction",
        "population": table.episodes[0].population.value,
        "intervals": {"confidence": CONFIDENCE, "method": "jackknife", "block": "episode", "stratum": "template"},
        "episodes": [_episode(episode) for episode in table.episodes],
        "models": {model: _model(table, model) for model in table.models},
        "differences": [
            {
                "metric": each.metric,
                "name": each.group,
                "first": each.first,
                "second": each.second,
                **each.difference.json(),
                "p": each.p_value,
                "p_holm": each.adjusted_p_value,
                "samples": each.samples,
            }
            for each in pairs
        ],
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
                "wanted": scores.population_size,
                **{metric.name: scores[metric.name].known for metric in METRICS},
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
        cells = {metric.name: table.cells.get((model, group.name, metric.name)) for metric in METRICS}
        rows.setdefault(group.kind.value, {})[group.name] = {
            name: {**cell.interval.json(), "samples": cell.samples} for name, cell in cells.items() if cell is not None
        }
    compared = {metric.name: compare_with_paper(table, model, metric.name) for metric in METRICS}
    return {
        "samples": len(samples),
        "wanted": samples.population_size,
        "coverage": samples.coverage,
        "calibration_error": calibration_error(samples.reliability).known,
        "distance_over_time_m": {
            f"{time_s:.1f}": float(total) / len(samples)
            for time_s, total in zip(future_times_s(), samples.distance_sum_m, strict=True)
            if len(samples)
        },
        "rows": rows,
        "paper": {
            name: {**vars(result), "ranking": None if result.ranking is None else vars(result.ranking)}
            for name, result in compared.items()
            if result is not None
        },
    }


def latex_files(tables: Iterable[Table], about: str) -> dict[str, str]:
    """Content by file name: the tables that are like the paper's, with its names of the models, without a float.

    Args:
        tables: All tables of an evaluation.
        about: What was scored, for the comment above the table.
    """
    chosen = [table for table in tables if table.key in BY_TEMPLATE]
    return {
        f"{table.key}.tex": replace(
            table,
            caption=f"{table.caption}; {about}",
            rows=tuple((_paper_name(str(model)), *cells) for model, *cells in table.rows),
        ).latex()
        for table in chosen
    }


def _paper_name(model: str) -> str:
    kind, colon, label = model.partition(LABEL)
    return PAPER_NAMES.get(kind, kind) + (f" {label}" if colon else "")


def new_folder(path: Path) -> None:
    """Makes the folder of a report; there may be an older report in it, which is replaced.

    Raises:
        InputError: It cannot be made.
    """
    with writing(path, "folder"):
        path.mkdir(parents=True, exist_ok=True)


def write_report(
    path: Path, scores: ScoreTable, pairs: Sequence[Difference], tables: Sequence[Table], text: str
) -> None:
    """Writes ``report.txt``, ``scores.json``, CSV files and LaTeX tables.

    Raises:
        InputError: The folder cannot be written.
    """
    about = f"population: {scores.episodes[0].population.value}; {len(scores.episodes)} episodes"
    files = {
        "report.txt": text + "\n",
        "scores.json": json.dumps(json_report(scores, pairs), indent=2, allow_nan=False) + "\n",
        **csv_files(scores, pairs),
        **latex_files(tables, about),
    }
    with writing(path, "folder"):
        for name, content in files.items():
            with whole_file(path / name) as file:
                file.write_text(content, encoding="utf-8")
