"""Scores of trajectory predictors on recorded episodes: every model on the same samples, with every metric."""

from collections.abc import Mapping
from dataclasses import dataclass

from siren_ros.evaluation.prediction.metrics.displacement import METRICS, MetricValue
from siren_ros.evaluation.prediction.protocol.hypotheses import checked
from siren_ros.evaluation.prediction.protocol.predictor import Predictor
from siren_ros.evaluation.prediction.protocol.samples import Population, ScoredSamples, samples_of
from siren_ros.evaluation.prediction.protocol.window import HistoryWindow
from siren_ros.recording.episode_record import EpisodeRecord
from siren_ros.scenario.levels import EmergencyLevel


@dataclass(frozen=True)
class EpisodeScores:
    """The scores of every model on one episode."""

    name: str
    """Name of the episode: the bag's folder."""
    template: str
    level: EmergencyLevel
    seed: int
    map_name: str
    population: Population
    models: Mapping[str, Mapping[str, MetricValue]]
    """By model, then by metric."""

    @property
    def samples(self) -> int:
        """Least number of samples of a model; models with different histories have different samples."""
        return min((value.samples for metrics in self.models.values() for value in metrics.values()), default=0)


def score_episode(
    name: str,
    record: EpisodeRecord,
    predictors: Mapping[str, Predictor],
    population: Population = Population.REGION,
) -> EpisodeScores:
    """Scores every predictor on an episode.

    Raises:
        InputError: The record does not describe its actors, or a predictor's hypotheses cannot be scored.
    """
    samples: dict[HistoryWindow, ScoredSamples] = {}
    models = {}
    for model, predictor in predictors.items():
        window = predictor.window
        if window not in samples:
            samples[window] = samples_of(record, window, population)
        batch = samples[window].batch
        hypotheses = checked(model, predictor.predict(batch), len(batch))
        truth = samples[window].future_xy_m
        models[model] = {metric.name: metric.compute(hypotheses, truth) for metric in METRICS}
    episode = record.description
    return EpisodeScores(name, episode.template, episode.level, episode.seed, episode.map_name, population, models)
