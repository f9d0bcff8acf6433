"""The scores of predictors on one episode: a value for each metric and sample."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from siren_ros.evaluation.prediction.metrics.calibration import Reliability
from siren_ros.evaluation.prediction.metrics.metric import MetricValue
from siren_ros.evaluation.prediction.metrics.table import METRIC_OF
from siren_ros.evaluation.prediction.protocol.samples import Population
from siren_ros.numerics.arrays import Codes, Floats, Ids
from siren_ros.scenario.levels import EmergencyLevel


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
    wanted: int
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
