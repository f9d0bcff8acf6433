"""Trajectory prediction: errors, samples, ratio of the references, ranking of the templates."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from siren_ros.evaluation.paper_comparison.compared import Compared
from siren_ros.evaluation.prediction.metrics.table import METRIC_OF
from siren_ros.evaluation.prediction.reports.groups import GroupKind
from siren_ros.evaluation.prediction.reports.paper_results import (
    PAPER_NAMES,
    PAPER_SAMPLES,
    TEMPLATES,
    PaperRow,
    paper_row,
)
from siren_ros.evaluation.prediction.reports.score_table import ScoreTable, strata, sums_of
from siren_ros.evaluation.prediction.scoring.episode_scores import EpisodeScores
from siren_ros.evaluation.statistics.block_sums import BlockSums, block_sums
from siren_ros.evaluation.statistics.interval import NOTHING, Interval
from siren_ros.evaluation.statistics.jackknife import estimate_of_mean, interval_of_mean, jackknife
from siren_ros.evaluation.statistics.rank_correlation import RANKED_MIN, ranking_interval

ERRORS: Final = {
    "ade_m": "ADE in m",
    "fde_m": "FDE in m",
    "rmse_5s_m": "RMSE at 5 s in m",
    "min_ade_6_m": "minADE6 in m",
    "min_fde_6_m": "minFDE6 in m",
}
"""The paper's three tables of prediction."""
_SINGLE_PATH: Final = {"min_ade_6_m": "ade_m", "min_fde_6_m": "fde_m"}
"""What the minimum over paths is for a predictor with one path; the paper's table leaves such rows out."""
MEAN: Final = "mean"
RANKING: Final = "rank correlation of the templates' ADE"
RATIO: Final = "mean ADE over that of CV"
SAMPLES: Final = "samples of an episode"
_ALL: Final = GroupKind.ALL.value


def own_level_only(scores: Sequence[EpisodeScores], level_of: Callable[[str], str]) -> list[EpisodeScores]:
    """The episodes at their templates' own levels, of which the paper has one each."""
    return [one for one in scores if one.template in TEMPLATES and one.level.name == level_of(one.template)]


def prediction_rows(table: ScoreTable) -> Iterator[Compared]:
    """All rows, those without a value of ours included.

    Args:
        table: Episodes at their templates' own levels, and the vehicles of the interaction region.
    """
    maps = ",".join(sorted({episode.map_name for episode in table.episodes}))
    for row in _rows(table):
        yield replace(row, map=maps)


def _rows(table: ScoreTable) -> Iterator[Compared]:
    for metric, title in ERRORS.items():
        for model, name in PAPER_NAMES.items():
            yield from _errors(table, metric, title, model, name)
    yield from _samples(table)
    yield from _ratios(table)
    yield from _rankings(table)


def _errors(table: ScoreTable, metric: str, title: str, model: str, name: str) -> Iterator[Compared]:
    row = paper_row(model, metric)
    if row is None or row is paper_row(model, _SINGLE_PATH.get(metric, "")):
        return
    for template in TEMPLATES:
        cell = table.cells.get((model, template, metric))
        yield Compared(title, name, template, row.by_template[template], NOTHING if cell is None else cell.interval)
    cell = table.cells.get((model, _ALL, metric))
    yield Compared(title, name, MEAN, row.mean, NOTHING if cell is None else cell.interval)


def _samples(table: ScoreTable) -> Iterator[Compared]:
    """Mean number of samples of an episode, with the interval over episodes."""
    template = np.array([episode.template for episode in table.episodes])
    counts = np.array([episode.samples for episode in table.episodes], dtype=np.float64)
    for name in TEMPLATES:
        here = counts[template == name]
        sums = block_sums(here, np.arange(len(here)), np.zeros(len(here), dtype=np.intp))
        found = interval_of_mean(sums)
        yield Compared(SAMPLES, "all vehicles", name, float(PAPER_SAMPLES[name]), found, digits=0)


def _sums(table: ScoreTable, *models: str) -> tuple[list[str], list[BlockSums]]:
    """Sums of the ADE over the episodes in which all of some models have a sample, with the names of their strata."""
    stratum = strata(table.episodes)
    found = []
    for model in models:
        samples = table.samples[model]
        found.append(sums_of(samples, METRIC_OF["ade_m"], np.ones(len(samples), dtype=np.bool_), stratum))
    there = np.logical_and.reduce([one.count > 0 for one in found])
    names = sorted({episode.template for episode in table.episodes})
    kept, of_kept = np.unique(stratum[there], return_inverse=True)
    sums = [BlockSums(one.total[there], one.count[there], of_kept.astype(np.intp)) for one in found]
    return [names[number] for number in kept.tolist()], sums


def _ratios(table: ScoreTable) -> Iterator[Compared]:
    reference = paper_row("cv", "ade_m")
    for model, name in PAPER_NAMES.items():
        row = paper_row(model, "ade_m")
        if row is not None and reference is not None and model != "cv":
            yield Compared(RATIO, name, MEAN, row.mean / reference.mean, _ratio(table, model))


def _ratio(table: ScoreTable, model: str) -> Interval:
    if model not in table.models or "cv" not in table.models:
        return NOTHING
    _, (own, reference) = _sums(table, model, "cv")

    if len(own) == 0:
        return NOTHING
    ratio = own.value() / reference.value()
    return jackknife(ratio, own.left_out() / reference.left_out(), own.stratum).interval()


def _rankings(table: ScoreTable) -> Iterator[Compared]:
    """Spearman's ρ between our templates and the paper's; the paper's own is 1."""
    for model, name in PAPER_NAMES.items():
        row = paper_row(model, "ade_m")
        if row is not None:
            yield Compared(RANKING, name, "Spearman", 1.0, _ranking(table, model, row), relative=False)


def _ranking(table: ScoreTable, model: str, paper: PaperRow) -> Interval:
    if model not in table.models:
        return NOTHING
    names, (sums,) = _sums(table, model)
    if len(names) < RANKED_MIN:
        return NOTHING
    estimates = [estimate_of_mean(sums.of(number)) for number in range(len(names))]
    there = [paper.by_template[name] for name in names]
    return ranking_interval(estimates, there)
