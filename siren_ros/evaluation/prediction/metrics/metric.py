"""What a metric is: a value for each sample, and how values become one."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from siren_ros.evaluation.prediction.protocol.hypotheses import Hypotheses
from siren_ros.evaluation.prediction.protocol.samples import ScoredSamples
from siren_ros.evaluation.statistics.block_sums import identity
from siren_ros.numerics.arrays import Floats


@dataclass(frozen=True)
class MetricValue:
    """A metric over some samples. Without samples ``value`` is 0 and means nothing."""

    value: float
    samples: int

    @property
    def valid(self) -> bool:
        """Whether there was a sample."""
        return self.samples > 0


@dataclass(frozen=True)
class Metric:
    """A metric: its name in files, its heading in tables, and its functions."""

    name: str
    label: str
    of_samples: Callable[[Hypotheses, ScoredSamples], Floats]
    """A value for each sample, shape ``(N,)``; NaN for a sample that the metric says nothing about."""
    of_mean: Callable[[Floats], Floats] = identity
    """What is done to the mean over samples: the root, of squares."""

    def value(self, of_samples: Floats) -> MetricValue:
        """The metric over some samples, from their values."""
        there = of_samples[~np.isnan(of_samples)]
        mean = self.of_mean(np.array([there.mean()]))[0] if len(there) else 0.0
        return MetricValue(float(mean), len(there))

    def compute(self, hypotheses: Hypotheses, samples: ScoredSamples) -> MetricValue:
        """The metric over all samples."""
        return self.value(self.of_samples(hypotheses, samples))
