"""All samples of all episodes of one model, as columns."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from siren_ros.evaluation.prediction.metrics.calibration import Reliability, no_reliability
from siren_ros.evaluation.prediction.metrics.table import METRICS
from siren_ros.evaluation.prediction.protocol.window import FUTURE_POINTS
from siren_ros.evaluation.prediction.scoring.episode_scores import EpisodeScores
from siren_ros.numerics.arrays import Codes, Flags, Floats, Rows


@dataclass(frozen=True)
class SampleTable:
    """One model's samples; columns of shape ``(N,)``."""

    episode: Rows
    """Position of the sample's episode among all episodes."""
    key: npt.NDArray[np.int64]
    """Tells the samples of an episode apart, whatever the model: ``step << 32 | actor_id``."""
    category: Codes
    moved_m: Floats
    values: Mapping[str, Floats]
    """By metric."""
    wanted: int
    """Samples of the population; more than there are where predictions are missing."""
    distance_sum_m: Floats
    """Over all samples, at each time of the grid; shape ``(FUTURE_POINTS,)``."""
    reliability: Reliability

    def __len__(self) -> int:
        return len(self.episode)

    @property
    def coverage(self) -> float:
        """Share of the population's samples that were scored; 1 without any sample."""
        return len(self) / self.wanted if self.wanted else 1.0

    def of_episodes(self, episodes: Flags) -> Flags:
        """Which samples are of some episodes."""
        return episodes[self.episode]


def sample_table(scores: Sequence[EpisodeScores], model: str) -> SampleTable:
    """The samples of one model."""
    parts = [episode.models[model] for episode in scores]
    counts = [len(part) for part in parts]
    reliability = no_reliability()
    for part in parts:
        reliability += part.reliability
    return SampleTable(
        episode=np.repeat(np.arange(len(parts)), counts),
        key=np.concatenate([(part.step << 32) | part.actor_id for part in parts]).astype(np.int64),
        category=np.concatenate([part.category for part in parts]),
        moved_m=np.concatenate([part.moved_m for part in parts]),
        values={metric.name: np.concatenate([part.values[metric.name] for part in parts]) for metric in METRICS},
        wanted=sum(part.wanted for part in parts),
        distance_sum_m=sum((part.distance_sum_m for part in parts), np.zeros(FUTURE_POINTS)),
        reliability=reliability,
    )
