"""Displacement metrics of trajectory prediction (paper, supplement "Evaluation Metrics"); one function for each.

Hypotheses have shape ``(N, k, T, 2)``, the most probable one first; the truth has shape ``(N, T, 2)``.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np

from siren_ros.numerics.arrays import Floats

BEST_OF: Final = 6
"""k of minADE and minFDE; a predictor with fewer hypotheses is scored on those it has."""


@dataclass(frozen=True)
class MetricValue:
    """A metric over some samples; without a sample there is no value, and ``value`` is 0."""

    value: float
    samples: int

    @property
    def valid(self) -> bool:
        """Whether there was anything to measure."""
        return self.samples > 0


def ade(hypotheses: Floats, truth: Floats) -> MetricValue:
    """Mean distance over time of the most probable hypothesis, in metres."""
    return _mean(_distances(hypotheses[:, :1], truth)[:, 0].mean(axis=-1))


def fde(hypotheses: Floats, truth: Floats) -> MetricValue:
    """Distance of the most probable hypothesis at the horizon, in metres."""
    return _mean(_distances(hypotheses[:, :1, -1:], truth[:, -1:])[:, 0, 0])


def min_ade_6(hypotheses: Floats, truth: Floats) -> MetricValue:
    """Mean distance over time of the hypothesis that is best in it, of the six most probable ones, in metres."""
    return _mean(_distances(hypotheses[:, :BEST_OF], truth).mean(axis=-1).min(axis=1))


def min_fde_6(hypotheses: Floats, truth: Floats) -> MetricValue:
    """Distance at the horizon of the hypothesis that is best in it, of the six most probable ones, in metres."""
    return _mean(_distances(hypotheses[:, :BEST_OF, -1:], truth[:, -1:])[..., 0].min(axis=1))


def rmse_at_horizon(hypotheses: Floats, truth: Floats) -> MetricValue:
    """Root mean square over the samples of the most probable hypothesis's distance at the horizon, in metres."""
    squared = _mean(_distances(hypotheses[:, :1, -1:], truth[:, -1:])[:, 0, 0] ** 2)
    return MetricValue(float(np.sqrt(squared.value)), squared.samples)


def _distances(hypotheses: Floats, truth: Floats) -> Floats:
    miss = hypotheses - truth[:, None]
    return np.hypot(miss[..., 0], miss[..., 1])


def _mean(values: Floats) -> MetricValue:
    return MetricValue(float(values.mean()) if len(values) else 0.0, len(values))


@dataclass(frozen=True)
class Metric:
    """A metric's name in results, its heading in tables, and how it is computed."""

    name: str
    label: str
    compute: Callable[[Floats, Floats], MetricValue]


METRICS: Final = (
    Metric("ade_m", "ADE", ade),
    Metric("fde_m", "FDE", fde),
    Metric("min_ade_6_m", "minADE6", min_ade_6),
    Metric("min_fde_6_m", "minFDE6", min_fde_6),
    Metric("rmse_5s_m", "RMSE@5s", rmse_at_horizon),
)
"""Every metric of the evaluation, in the order of reports."""
