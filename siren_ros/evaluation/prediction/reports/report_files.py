"""The files of a report: CSV, JSON, and LaTeX tables like the paper's."""

import csv
import io
import json
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, Final

from siren_ros.errors import whole_file, writing
from siren_ros.evaluation.prediction.episode_scores import EpisodeScores
from siren_ros.evaluation.prediction.metrics import BINS, METRICS, MetricValue, calibration_error
from siren_ros.evaluation.prediction.reports.paper_results import (
    PAPER_NAMES,
    compare_with_paper,
    paper_row,
    paper_value,
)
from siren_ros.evaluation.prediction.reports.score_table import Cell, Difference, GroupKind, ScoreTable
from siren_ros.evaluation.prediction.reports.text_report import pair
from siren_ros.evaluation.prediction.samples import future_times_s
from siren_ros.evaluation.statistics.interval import CONFIDENCE, Interval
from siren_ros.scenario.paper import TEMPLATES


def csv_files(table: ScoreTable, found: Sequence[Difference]) -> dict[str, str]:
    """Content by file name."""
    return {
        "scores.csv": _csv_text(
            ("model", "rows", "name", "metric", "value", "low", "high", "samples", "episodes", "paper"), _scores(table)
        ),
        "episodes.csv": _csv_text(
            ("episode", "template", "level", "seed", "map", "model", "metric", "value", "samples"), _episodes(table)
        ),
        "differences.csv": _csv_text(
            ("metric", "name", "first", "second", "difference", "low", "high", "p", "p_holm", "samples"),
            _differences(found),
        ),
        "horizon.csv": _csv_text(("model", "time_s", "distance_m"), _horizon(table)),
        "calibration.csv": _csv_text(
            ("model", "from", "to", "hypotheses", "mean_probability", "share_best"), _calibration(table)
        ),
    }


def _csv_text(head: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow(head)
    writer.writerows(rows)
    return buffer.getvalue()


def _scores(table: ScoreTable) -> Iterable[Sequence[object]]:
    kinds = {group.name: group.kind for group in table.groups}
    for (model, group, metric), cell in table.cells.items():
        found = cell.interval
        bounds = (found.low, found.high) if found.bounded else ("", "")
        row = paper_row(model, metric)
        paper = None if row is None else row.mean if kinds[group] is GroupKind.ALL else row.by_template.get(group)
        value = found.value if found.valid else ""
        known = "" if paper is None else paper
        yield model, kinds[group].value, group, metric, value, *bounds, cell.samples, found.blocks, known


def _episodes(table: ScoreTable) -> Iterable[Sequence[object]]:
    for episode in table.episodes:
        head = (episode.name, episode.template, episode.level.name, episode.seed, episode.map_name)
        for model, scores in episode.models.items():
            for metric in METRICS:
                value = scores[metric.name]
                yield *head, model, metric.name, value.value if value.valid else "", value.samples


def _differences(found: Sequence[Difference]) -> Iterable[Sequence[object]]:
    for one in found:
        known = one.difference
        bounds = (known.low, known.high) if known.bounded else ("", "")
        value = known.value if known.valid else ""
        head = (one.metric, one.group, one.first, one.second)
        yield *head, value, *bounds, one.p_value, one.adjusted_p_value, one.samples


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


_TABLES: Final = {
    "prediction.tex": (("ade_m", "fde_m"), "ADE/FDE (m) over a 5-s prediction horizon"),
    "rmse.tex": (("rmse_5s_m",), "RMSE (m) at the 5-s horizon"),
    "best_of_six.tex": (("min_ade_6_m", "min_fde_6_m"), "minADE$_6$/minFDE$_6$ (m)"),
    "miss_rate.tex": (("miss_rate_6",), "share of samples whose best of six hypotheses ends more than 2 m away"),
}
_ESCAPED: Final = str.maketrans({"_": r"\_", "%": r"\%", "&": r"\&", "#": r"\#", "$": r"\$"})


def latex_tables(table: ScoreTable, compare_paper: bool) -> dict[str, str]:
    """Content by file name: a table for each file, without a float around it."""
    return {name: _tabular(table, *about, compare_paper) for name, about in _TABLES.items()}


def _tabular(table: ScoreTable, metrics: Sequence[str], what: str, compare_paper: bool) -> str:
    own = [group.name for group in table.of_kind(GroupKind.TEMPLATE)]
    templates = [*TEMPLATES, *(name for name in own if name not in TEMPLATES)] if compare_paper else own
    lines = [
        f"% {what}; population: {table.episodes[0].population.value}; {len(table.episodes)} episodes",
        rf"\begin{{tabular}}{{l{'c' * (len(templates) + 1)}}}",
        r"\toprule",
        _row("Model", [*map(_latex_text, templates), "Mean"]),
        r"\midrule",
    ]
    for model in table.models:
        names = (*templates, GroupKind.ALL.value)
        lines.append(
            _row(
                _latex_text(_shown(model)), [pair([table.value(model, name, one) for one in metrics]) for name in names]
            )
        )
    papers = list(_paper_lines(templates, metrics)) if compare_paper else []
    if papers:
        lines += [r"\midrule", *papers]
    return "\n".join([*lines, r"\bottomrule", r"\end{tabular}", ""])


def _paper_lines(templates: Sequence[str], metrics: Sequence[str]) -> Iterator[str]:
    """The paper's rows; none where it has no such metric."""
    for model, name in PAPER_NAMES.items():
        rows = [row for metric in metrics if (row := paper_row(model, metric)) is not None]
        if rows:
            cells = [pair([row.by_template.get(template) for row in rows]) for template in templates]
            yield _row(f"{name} (paper)", [*cells, pair([row.mean for row in rows])])


def _shown(model: str) -> str:
    kind, colon, label = model.partition(":")
    return PAPER_NAMES.get(kind, kind) + (f" {label}" if colon else "")


def _latex_text(text: str) -> str:
    return text.translate(_ESCAPED)


def _row(head: str, cells: Sequence[str]) -> str:
    return " & ".join([head, *cells]) + r" \\"


def new_folder(path: Path) -> None:
    """Makes the folder of a report; there may be an older report in it, which is replaced.

    Raises:
        InputError: It cannot be made.
    """
    with writing(path, "folder"):
        path.mkdir(parents=True, exist_ok=True)


def write_report(path: Path, table: ScoreTable, found: Sequence[Difference], text: str, compare_paper: bool) -> None:
    """Writes ``report.txt``, ``scores.json``, CSV files and LaTeX tables.

    Raises:
        InputError: The folder cannot be written.
    """
    files = {
        "report.txt": text + "\n",
        "scores.json": json.dumps(json_report(table, found), indent=2, allow_nan=False) + "\n",
        **csv_files(table, found),
        **latex_tables(table, compare_paper),
    }
    with writing(path, "folder"):
        for name, content in files.items():
            with whole_file(path / name) as file:
                file.write_text(content, encoding="utf-8")
