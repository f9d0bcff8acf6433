"""Scores of all models in all groups, with intervals over the episodes."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from siren_ros.evaluation.prediction.metrics.metric import Metric
from siren_ros.evaluation.prediction.metrics.table import METRICS
from siren_ros.evaluation.prediction.reports.groups import Group, GroupKind, groups_of
from siren_ros.evaluation.prediction.reports.sample_table import SampleTable, sample_table
from siren_ros.evaluation.prediction.scoring.episode_scores import EpisodeScores
from siren_ros.evaluation.statistics.block_sums import BlockSums, block_sums
from siren_ros.evaluation.statistics.interval import Interval
from siren_ros.evaluation.statistics.jackknife import interval_of_mean
from siren_ros.numerics.arrays import Flags, Rows

PARAMETER_METRICS: Final = frozenset({"ade_m", "fde_m"})
"""Of the many rows by parameter."""


@dataclass(frozen=True)
class Cell:
    """One metric of one model in one group."""

    interval: Interval
    """The mean over the group's templates, each counted once, of the means over their samples."""
    samples: int


@dataclass(frozen=True)
class ScoreTable:
    """All scores of an evaluation."""

    episodes: tuple[EpisodeScores, ...]
    models: tuple[str, ...]
    groups: tuple[Group, ...]
    samples: Mapping[str, SampleTable]
    """By model."""
    cells: Mapping[tuple[str, str, str], Cell]
    """By model, name of the group, and metric."""

    def of_kind(self, kind: GroupKind) -> tuple[Group, ...]:
        """The groups of one kind."""
        return tuple(group for group in self.groups if group.kind is kind)

    def value(self, model: str, group: str, metric: str) -> float | None:
        """A value; None where there is none."""
        cell = self.cells.get((model, group, metric))
        return cell.interval.value if cell is not None and cell.interval.valid else None


def score_table(scores: Sequence[EpisodeScores]) -> ScoreTable:
    """All scores of some episodes.

    Args:
        scores: At least one episode, all with the same models.
    """
    models = tuple(scores[0].models)
    samples = {model: sample_table(scores, model) for model in models}
    groups = groups_of(scores)
    stratum = strata(scores)
    cells: dict[tuple[str, str, str], Cell] = {}
    for model, table in samples.items():
        for group in groups:
            chosen = chosen_samples(table, group)
            for metric in METRICS:
                if group.kind is GroupKind.PARAMETER and metric.name not in PARAMETER_METRICS:
                    continue
                sums = sums_of(table, metric, chosen, stratum)
                cells[model, group.name, metric.name] = Cell(interval_of_mean(sums), int(sums.count.sum()))
    return ScoreTable(tuple(scores), models, groups, samples, cells)


def strata(scores: Sequence[EpisodeScores]) -> Rows:
    """Number of each episode's template, shape ``(B,)``."""
    return np.unique([episode.template for episode in scores], return_inverse=True)[1].astype(np.intp)


def chosen_samples(table: SampleTable, group: Group) -> Flags:
    """Which of a model's samples a group counts, shape ``(N,)``."""
    chosen = table.of_episodes(group.episodes)
    return chosen if group.category is None else chosen & (table.category == group.category)


def sums_of(table: SampleTable, metric: Metric, chosen: Flags, stratum: Rows) -> BlockSums:
    """Sums of a metric over the episodes."""
    return block_sums(table.values[metric.name][chosen], table.episode[chosen], stratum, metric.of_mean)
