"""Every pair of models on the samples that both have: how much they differ, and whether that is chance."""

from dataclasses import dataclass
from itertools import combinations
from typing import Final

import numpy as np

from siren_ros.evaluation.prediction.metrics.metric import Metric
from siren_ros.evaluation.prediction.metrics.table import METRIC_OF
from siren_ros.evaluation.prediction.reports.groups import GroupKind
from siren_ros.evaluation.prediction.reports.sample_table import SampleTable
from siren_ros.evaluation.prediction.reports.score_table import ScoreTable, strata
from siren_ros.evaluation.statistics.block_sums import block_sums
from siren_ros.evaluation.statistics.holm import holm
from siren_ros.evaluation.statistics.interval import Interval
from siren_ros.evaluation.statistics.paired_difference import PairedDifference, paired_difference
from siren_ros.numerics.arrays import Flags, Rows

COMPARED: Final = ("ade_m", "fde_m", "min_ade_6_m", "min_fde_6_m")


@dataclass(frozen=True)
class Difference:
    """The first model minus the second, on their common samples."""

    metric: str
    group: str
    """``all`` or a template."""
    first: str
    second: str
    difference: Interval
    p_value: float
    adjusted_p_value: float
    """By Holm's correction over all pairs of the same metric and group."""
    samples: int


def differences(table: ScoreTable, seed: int = 0) -> tuple[Difference, ...]:
    """All pairs of models, with all compared metrics, over all templates and in each."""
    stratum = strata(table.episodes)
    pairs = list(combinations(table.models, 2))
    common = {pair: common_rows(*(table.samples[model] for model in pair)) for pair in pairs}
    found = []
    for metric in COMPARED:
        for group in (*table.of_kind(GroupKind.ALL), *table.of_kind(GroupKind.TEMPLATE)):
            results = [
                _compare(table, pair, common[pair], METRIC_OF[metric], group.episodes, stratum, seed) for pair in pairs
            ]
            adjusted = holm([result.p_value for result, _ in results])
            found += [
                Difference(metric, group.name, *pair, result.difference, result.p_value, together, samples)
                for pair, (result, samples), together in zip(pairs, results, adjusted, strict=True)
            ]
    return tuple(found)


def common_rows(one: SampleTable, two: SampleTable) -> tuple[Rows, Rows]:
    """Rows of the samples that both models have, in the same order."""
    keys = [np.stack((table.episode, table.key), axis=1) for table in (one, two)]
    both, inverse = np.unique(np.concatenate(keys), axis=0, return_inverse=True)
    place = np.full((2, len(both)), -1, dtype=np.intp)
    inverse = inverse.ravel()
    place[0, inverse[: len(one)]] = np.arange(len(one))
    place[1, inverse[len(one) :]] = np.arange(len(two))
    there = (place >= 0).all(axis=0)
    return place[0, there], place[1, there]


def _compare(
    table: ScoreTable,
    pair: tuple[str, str],
    rows: tuple[Rows, Rows],
    metric: Metric,
    episodes: Flags,
    stratum: Rows,
    seed: int,
) -> tuple[PairedDifference, int]:
    sums = []
    for model, own in zip(pair, rows, strict=True):
        samples = table.samples[model]
        chosen = own[episodes[samples.episode[own]]]
        sums.append(block_sums(samples.values[metric.name][chosen], samples.episode[chosen], stratum, metric.of_mean))
    first, second = sums
    return paired_difference(first, second, np.random.default_rng(seed)), int(first.count.sum())
