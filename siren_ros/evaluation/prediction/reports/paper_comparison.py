"""Our scores against the paper's: on which maps, deviation of the mean, ranking of the templates."""

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from siren_ros.evaluation.prediction.reports.groups import GroupKind
from siren_ros.evaluation.prediction.reports.paper_results import PAPER_MAP, PaperRow, paper_row
from siren_ros.evaluation.prediction.reports.score_table import ScoreTable
from siren_ros.evaluation.prediction.scoring.episode_scores import EpisodeScores
from siren_ros.evaluation.statistics.rank_correlation import RankCorrelation, rank_correlation


def maps_next_to_the_papers(episodes: Iterable[EpisodeScores]) -> str:
    """The maps of some episodes, with their numbers, and the paper's: other maps give other errors."""
    counts = Counter(episode.map_name for episode in episodes)
    if list(counts) == [PAPER_MAP]:
        return f"map: {PAPER_MAP}, the paper's"
    named = ", ".join(f"{name} ({count})" for name, count in sorted(counts.items()))
    return f"{'map' if len(counts) == 1 else 'maps, pooled'}: {named}; the paper's is {PAPER_MAP}"


@dataclass(frozen=True)
class PaperComparison:
    """One metric of one model; None where there is no value."""

    mean: float | None
    """Ours, over all our templates."""
    paper_mean: float
    """The paper's, over all its templates."""
    paper_mean_same_templates: float | None
    """The paper's, over those templates that were scored here."""
    deviation: float | None
    """Of our mean from the paper's: +0.4 is 40 % above."""
    deviation_same_templates: float | None
    """The same, both over the templates in common."""
    ranking: RankCorrelation | None
    """Of the templates in common, from three on."""


def compare_with_paper(table: ScoreTable, model: str, metric: str) -> PaperComparison | None:
    """The comparison; None where the paper has no such row."""
    row = paper_row(model, metric)
    if row is None:
        return None
    ours = {group.name: table.value(model, group.name, metric) for group in table.of_kind(GroupKind.TEMPLATE)}
    common = {name: value for name, value in ours.items() if value is not None and name in row.by_template}
    there = [row.by_template[name] for name in common]
    mean = table.value(model, GroupKind.ALL, metric)
    same = _same_mean(row, there)
    return PaperComparison(
        mean=mean,
        paper_mean=row.mean,
        paper_mean_same_templates=same,
        deviation=None if mean is None else mean / row.mean - 1.0,
        deviation_same_templates=None if same is None else float(np.mean(list(common.values()))) / same - 1.0,
        ranking=rank_correlation(list(common.values()), there),
    )


def _same_mean(row: PaperRow, values: list[float]) -> float | None:
    if len(values) == len(row.by_template):
        return row.mean
    return float(np.mean(values)) if values else None
