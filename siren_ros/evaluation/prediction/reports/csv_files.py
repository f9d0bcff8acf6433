"""Scores as CSV: one line for each value, so that any program can make its own tables of them."""

import csv
import io
from collections.abc import Iterable, Sequence

from siren_ros.evaluation.prediction.metrics.calibration import BINS
from siren_ros.evaluation.prediction.metrics.table import METRICS
from siren_ros.evaluation.prediction.protocol.window import future_times_s
from siren_ros.evaluation.prediction.reports.differences import Difference
from siren_ros.evaluation.prediction.reports.groups import GroupKind
from siren_ros.evaluation.prediction.reports.paper_results import paper_row
from siren_ros.evaluation.prediction.reports.score_table import ScoreTable


def csv_files(table: ScoreTable, found: Sequence[Difference]) -> dict[str, str]:
    """Content by file name."""
    return {
        "scores.csv": _text(
            ("model", "rows", "name", "metric", "value", "low", "high", "samples", "episodes", "paper"), _scores(table)
        ),
        "episodes.csv": _text(
            ("episode", "template", "level", "seed", "map", "model", "metric", "value", "samples"), _episodes(table)
        ),
        "differences.csv": _text(
            ("metric", "name", "first", "second", "difference", "low", "high", "p", "p_holm", "samples"),
            _differences(found),
        ),
        "horizon.csv": _text(("model", "time_s", "distance_m"), _horizon(table)),
        "calibration.csv": _text(
            ("model", "from", "to", "hypotheses", "mean_probability", "share_best"), _calibration(table)
        ),
    }


def _text(head: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
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
