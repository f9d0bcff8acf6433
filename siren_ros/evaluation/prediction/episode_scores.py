"""Scores predictors on an episode: every model with every metric on each of its samples.

A sample has a category: what its vehicle does in the window.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from enum import IntEnum
from functools import cache

import numpy as np
import numpy.typing as npt

from siren_ros.evaluation.prediction.metrics import (
    METRIC_OF,
    METRICS,
    MetricValue,
    Reliability,
    distances,
    reliability_of,
)
from siren_ros.evaluation.prediction.predictors import Hypotheses, Predictor, checked
from siren_ros.evaluation.prediction.samples import (
    LAST_FUTURE_STEP,
    Population,
    SampleBatch,
    ScoredSamples,
    samples_of,
)
from siren_ros.evaluation.prediction.submission import EpisodePredictions
from siren_ros.numerics.arrays import Codes, Floats, Ids
from siren_ros.recording.episode_record import EpisodeRecord
from siren_ros.scenario.paper import EmergencyLevel
from siren_ros.world.actors import Mode


class Category(IntEnum):
    """Each sample has one."""

    EMV = 0
    YIELDING = 1
    """A civilian whose window of 5 s holds a step of a yield response; it may begin there."""
    HELD = 2
    """A civilian that stands in the hold of a pull-over at the present."""
    OTHER = 3


def categories_of(record: EpisodeRecord, batch: SampleBatch) -> Codes:
    """Category of each sample of an episode, shape ``(N,)``; from the recorded modes, present and future."""
    rows = record.rows
    category = np.full(len(batch), Category.OTHER, dtype=np.uint8)
    if not len(batch):
        return category
    actor, step = batch.actor_id, batch.sample_step
    span = int(rows.step.max()) + LAST_FUTURE_STEP + 1
    keys = rows.actor_id.astype(np.int64) * span + rows.step
    now = np.searchsorted(keys, actor * span + step)
    end = np.searchsorted(keys, actor * span + step + LAST_FUTURE_STEP, side="right")
    yielding = (rows.mode >= Mode.YIELD_REACTING) & (rows.mode <= Mode.YIELD_HOLD)
    before = np.concatenate(([0], np.cumsum(yielding)))
    category[before[end] > before[now]] = Category.YIELDING
    category[rows.mode[now] == Mode.YIELD_HOLD] = Category.HELD
    category[batch.actors.is_emv[batch.target]] = Category.EMV
    return category


@dataclass(frozen=True)
class ModelScores:
    """The scores of one model on N samples of an episode, sorted by step and then by actor."""

    step: npt.NDArray[np.int64]
    """The present of each sample, shape ``(N,)``."""
    actor_id: Ids
    category: Codes
    """``Category`` of each sample."""
    moved_m: Floats
    """Distance between the true places at the present and at the horizon, shape ``(N,)``."""
    values: Mapping[str, Floats]
    """By metric, shape ``(N,)``; NaN where it says nothing."""
    distance_sum_m: Floats
    """Of the most probable paths from the truth, at each time of the grid; shape ``(FUTURE_POINTS,)``."""
    reliability: Reliability
    population_size: int
    """Number of samples of the population; more than N where predictions are missing."""

    def __len__(self) -> int:
        return len(self.step)

    def __getitem__(self, metric: str) -> MetricValue:
        """A metric over all samples."""
        return METRIC_OF[metric].value(self.values[metric])


@dataclass(frozen=True)
class EpisodeScores:
    """The scores of every model on one episode."""

    name: str
    """Of the episode: the bag's folder."""
    template: str
    level: EmergencyLevel
    seed: int
    map_name: str
    population: Population
    parameters: Mapping[str, float]
    """The template's numbers: ``emv.speed_mps``."""
    models: Mapping[str, ModelScores]

    @property
    def samples(self) -> int:
        """Least number of samples of a model; models with different histories have different samples."""
        return min((len(scores) for scores in self.models.values()), default=0)


def score_episode(
    name: str,
    record: EpisodeRecord,
    predictors: Mapping[str, Predictor],
    population: Population = Population.REGION,
    submitted: Mapping[str, EpisodePredictions] | None = None,
) -> EpisodeScores:
    """Scores every predictor, and every submission, on an episode.

    Args:
        name: Of the episode, for reports.
        record: The episode.
        predictors: By the name of the model.
        population: Whose windows count.
        submitted: What other programs predicted in this episode, by the name of the model.

    Raises:
        InputError: The record does not describe its actors, or a model's hypotheses cannot be scored.
    """
    answers = answers_of(record, predictors, population, submitted or {})
    episode = record.description
    return EpisodeScores(
        name=name,
        template=episode.template,
        level=episode.level,
        seed=episode.seed,
        map_name=episode.map_name,
        population=population,
        parameters=episode.template_values,
        models={each.model: model_scores(record, each) for each in answers},
    )


@dataclass(frozen=True)
class Answers:
    """What one model predicts in an episode."""

    model: str
    samples: ScoredSamples
    """Those that there are hypotheses for."""
    hypotheses: Hypotheses
    """One row for each sample."""
    population_size: int
    """Number of samples of the population."""


def answers_of(
    record: EpisodeRecord,
    predictors: Mapping[str, Predictor],
    population: Population,
    submitted: Mapping[str, EpisodePredictions],
) -> Iterator[Answers]:
    """The hypotheses of all models, one model after the other; arguments and errors as those of ``score_episode``."""
    samples_with = cache(lambda window: samples_of(record, window, population))
    for model, predictor in predictors.items():
        samples = samples_with(predictor.window)
        hypotheses = checked(model, predictor.predict(samples.batch), len(samples))
        yield Answers(model, samples, hypotheses, len(samples))
    for model, predictions in submitted.items():
        samples = samples_with(predictions.window)
        rows, hypotheses = predictions.meet(samples.batch)
        yield Answers(model, samples.select(rows), hypotheses, len(samples))


def model_scores(record: EpisodeRecord, answers: Answers) -> ModelScores:
    """The scores of one model in an episode."""
    samples, hypotheses = answers.samples, answers.hypotheses
    batch, truth = samples.batch, samples.future_xy_m
    return ModelScores(
        step=batch.sample_step,
        actor_id=batch.actors.actor_id[batch.target],
        category=categories_of(record, batch),
        moved_m=np.hypot(*(truth[:, -1] - batch.xy_m).T),
        values={metric.name: metric.of_samples(hypotheses, samples) for metric in METRICS},
        distance_sum_m=distances(hypotheses.xy_m[:, :1], truth)[:, 0].sum(axis=0),
        reliability=reliability_of(hypotheses, truth),
        population_size=answers.population_size,
    )
