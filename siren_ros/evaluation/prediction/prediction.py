"""Trajectory prediction on recorded episodes: every model on the same samples, every metric of the table."""

from collections.abc import Mapping
from dataclasses import dataclass

from siren_ros.evaluation.prediction.displacement_metrics import METRICS, MetricValue
from siren_ros.evaluation.prediction.prediction_samples import ScoredSamples, samples_of
from siren_ros.evaluation.prediction.prediction_window import HistoryWindow
from siren_ros.evaluation.prediction.predictors import Predictor, hypotheses_of
from siren_ros.recording.episode_record import EpisodeRecord
from siren_ros.scenario.levels import EmergencyLevel


@dataclass(frozen=True)
class EpisodeScores:
    """What every model scores on one episode."""

    name: str
    """Of the episode, as the user knows it: the bag's folder."""
    template: str
    level: EmergencyLevel
    seed: int
    map_name: str
    models: Mapping[str, Mapping[str, MetricValue]]
    """By model, then by metric."""

    @property
    def samples(self) -> int:
        """The least number of samples that a model was scored on; models with other histories have other samples."""
        return min((value.samples for metrics in self.models.values() for value in metrics.values()), default=0)


def score_episode(name: str, record: EpisodeRecord, predictors: Mapping[str, Predictor]) -> EpisodeScores:
    """Score every predictor on an episode.

    Raises:
        InputError: The record does not describe its actors, or a predictor's answer cannot be scored.
    """
    samples: dict[HistoryWindow, ScoredSamples] = {}
    models = {}
    for model, predictor in predictors.items():
        window = predictor.window
        if window not in samples:
            samples[window] = samples_of(record, window)
        hypotheses = hypotheses_of(model, predictor, samples[window].batch)
        truth = samples[window].future_xy_m
        models[model] = {metric.name: metric.compute(hypotheses, truth) for metric in METRICS}
    episode = record.description
    return EpisodeScores(name, episode.template, episode.level, episode.seed, episode.map_name, models)
