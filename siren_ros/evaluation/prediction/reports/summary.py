"""Scores of several episodes compared with the paper's: means over templates, deviation, rank correlation."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from siren_ros.evaluation.prediction.metrics.displacement import METRICS
from siren_ros.evaluation.prediction.reports.paper_results import PAPER, paper_value
from siren_ros.evaluation.prediction.scoring import EpisodeScores
from siren_ros.evaluation.statistics.rank_correlation import rank_correlation


@dataclass(frozen=True)
class MetricSummary:
    """One metric of one model over the templates; None where there is no value."""

    by_template: Mapping[str, float]
    """Mean over the episodes of each template, in the order of names."""
    mean: float | None
    """Over the templates, each counted once, as the paper does."""
    paper_by_template: Mapping[str, float]
    """The paper's values of the same templates, where it has them."""
    paper_mean: float | None
    """The paper's mean over all its templates."""
    paper_mean_same_templates: float | None
    """The paper's mean over those templates that were scored here."""
    deviation: float | None
    """Of the mean from the paper's over all its templates: +0.4 is 40 % above."""
    deviation_same_templates: float | None
    """Of the mean from the paper's, both over the templates that the two have in common."""
    spearman: float | None
    """Rank correlation with the paper over the templates in common, from three templates on."""


Summary = Mapping[str, Mapping[str, MetricSummary]]
"""By model, then by metric."""


def summarise(scores: Sequence[EpisodeScores]) -> Summary:
    """Summary of every model and metric of some episodes. Episodes without a sample do not count."""
    models = dict.fromkeys(model for episode in scores for model in episode.models)
    return {model: {metric.name: _summary(scores, model, metric.name) for metric in METRICS} for model in models}


def _summary(scores: Sequence[EpisodeScores], model: str, metric: str) -> MetricSummary:
    collected: dict[str, list[float]] = {}
    for episode in scores:
        value = episode.models[model][metric]
        if value.valid:
            collected.setdefault(episode.template, []).append(value.value)
    by_template = {template: float(np.mean(collected[template])) for template in sorted(collected)}
    row = PAPER.get((model, metric))
    paper = {} if row is None else row.by_template
    common = [template for template in by_template if template in paper]
    here = [by_template[template] for template in common]
    there = [paper[template] for template in common]
    ranking = rank_correlation(here, there)
    mean, paper_mean = _mean(list(by_template.values())), None if row is None else row.mean
    paper_mean_common = paper_mean if len(common) == len(paper) else _mean(there)
    return MetricSummary(
        by_template=by_template,
        mean=mean,
        paper_by_template=dict(zip(common, there, strict=True)),
        paper_mean=paper_mean,
        paper_mean_same_templates=paper_mean_common,
        deviation=_deviation(mean, paper_mean),
        deviation_same_templates=_deviation(_mean(here), paper_mean_common),
        spearman=None if ranking is None else ranking.rho,
    )


def _mean(values: Sequence[float]) -> float | None:
    return float(np.mean(values)) if values else None


def _deviation(value: float | None, reference: float | None) -> float | None:
    return None if value is None or reference is None else value / reference - 1.0


def as_json(scores: Sequence[EpisodeScores], summary: Summary) -> dict[str, Any]:
    """Everything as JSON types; null where there is no value."""
    return {
        "task": "prediction",
        "episodes": [_episode_json(episode) for episode in scores],
        "summary": {
            model: {metric: dict(vars(values)) for metric, values in metrics.items()}
            for model, metrics in summary.items()
        },
    }


def _episode_json(episode: EpisodeScores) -> dict[str, Any]:
    return {
        "name": episode.name,
        "template": episode.template,
        "level": episode.level.name,
        "seed": episode.seed,
        "map": episode.map_name,
        "population": episode.population.value,
        "models": {
            model: {
                "samples": min(value.samples for value in metrics.values()),
                **{name: value.value if value.valid else None for name, value in metrics.items()},
                "paper": {
                    name: known for name in metrics if (known := paper_value(model, name, episode.template)) is not None
                },
            }
            for model, metrics in episode.models.items()
        },
    }
