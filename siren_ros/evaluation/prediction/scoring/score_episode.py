"""Scores trajectory predictors on an episode: every model with every metric on each of its samples."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from siren_ros.evaluation.prediction.metrics.calibration import reliability_of
from siren_ros.evaluation.prediction.metrics.displacement import distances
from siren_ros.evaluation.prediction.metrics.table import METRICS
from siren_ros.evaluation.prediction.protocol.hypotheses import Hypotheses, checked
from siren_ros.evaluation.prediction.protocol.predictor import Predictor
from siren_ros.evaluation.prediction.protocol.samples import Population, ScoredSamples, samples_of
from siren_ros.evaluation.prediction.protocol.window import HistoryWindow
from siren_ros.evaluation.prediction.scoring.categories import categories_of
from siren_ros.evaluation.prediction.scoring.episode_scores import EpisodeScores, ModelScores
from siren_ros.evaluation.prediction.submitted.submission import SubmittedPart
from siren_ros.recording.episode_record import EpisodeRecord


def score_episode(
    name: str,
    record: EpisodeRecord,
    predictors: Mapping[str, Predictor],
    population: Population = Population.REGION,
    submitted: Mapping[str, SubmittedPart] | None = None,
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
    models = {
        one.model: model_scores(record, one) for one in answers_of(record, predictors, population, submitted or {})
    }
    episode = record.description
    return EpisodeScores(
        name=name,
        template=episode.template,
        level=episode.level,
        seed=episode.seed,
        map_name=episode.map_name,
        population=population,
        parameters=episode.template_values,
        models=models,
    )


@dataclass(frozen=True)
class Answers:
    """What one model predicts in an episode."""

    model: str
    samples: ScoredSamples
    """Those that there are hypotheses for."""
    hypotheses: Hypotheses
    """One row for each sample."""
    wanted: int
    """Number of samples of the population."""


def answers_of(
    record: EpisodeRecord,
    predictors: Mapping[str, Predictor],
    population: Population,
    submitted: Mapping[str, SubmittedPart],
) -> Iterator[Answers]:
    """The hypotheses of all models, one model after the other; arguments and errors as those of ``score_episode``."""
    windows: dict[HistoryWindow, ScoredSamples] = {}

    def samples_with(window: HistoryWindow) -> ScoredSamples:
        if window not in windows:
            windows[window] = samples_of(record, window, population)
        return windows[window]

    for model, predictor in predictors.items():
        samples = samples_with(predictor.window)
        hypotheses = checked(model, predictor.predict(samples.batch), len(samples))
        yield Answers(model, samples, hypotheses, len(samples))
    for model, part in submitted.items():
        samples = samples_with(part.window)
        rows, hypotheses = part.meet(samples.batch)
        yield Answers(model, samples.select(rows), hypotheses, len(samples))


def model_scores(record: EpisodeRecord, answers: Answers) -> ModelScores:
    """The scores of one model in an episode."""
    samples, hypotheses = answers.samples, answers.hypotheses
    batch, truth = samples.batch, samples.future_xy_m
    return ModelScores(
        step=batch.step[batch.actors.frame[batch.target]],
        actor_id=batch.actors.actor_id[batch.target],
        category=categories_of(record, batch),
        moved_m=np.hypot(*(truth[:, -1] - batch.xy_m).T),
        values={metric.name: metric.of_samples(hypotheses, samples) for metric in METRICS},
        distance_sum_m=distances(hypotheses.xy_m[:, :1], truth)[:, 0].sum(axis=0),
        reliability=reliability_of(hypotheses, truth),
        wanted=answers.wanted,
    )
