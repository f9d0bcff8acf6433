"""Displacement metrics of trajectory prediction (paper, supplement "Evaluation Metrics"); one function for each.

The truth has shape ``(N, T, 2)``.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np

from siren_ros.evaluation.prediction.protocol.hypotheses import Hypotheses
from siren_ros.numerics.arrays import Floats

BEST_OF: Final = 6
"""k of minADE and minFDE; a predictor with fewer hypotheses is scored on those it has."""


@dataclass(frozen=True)
class MetricValue:
    """A metric over some samples. Without samples ``value`` is 0 and means nothing."""

    value: float
    samples: int

    @property
    def valid(self) -> bool:
        """Whether there was a sample."""
        return self.samples > 0


def ade(hypotheses: Hypotheses, truth: Floats) -> MetricValue:
    """Mean distance over time of the most probable hypothesis, in metres."""
    return _mean(_distances(hypotheses.xy_m[:, :1], truth)[:, 0].mean(axis=-1))


def fde(hypotheses: Hypotheses, truth: Floats) -> MetricValue:
    """Distance of the most probable hypothesis at the horizon, in metres."""
    return _mean(_distances(hypotheses.xy_m[:, :1, -1:], truth[:, -1:])[:, 0, 0])


def min_ade_6(hypotheses: Hypotheses, truth: Floats) -> MetricValue:
    """Least mean distance over time of the six most probable hypotheses, in metres."""
    return _mean(_distances(hypotheses.xy_m[:, :BEST_OF], truth).mean(axis=-1).min(axis=1))


def min_fde_6(hypotheses: Hypotheses, truth: Floats) -> MetricValue:
    """Least distance at the horizon of the six most probable hypotheses, in metres."""
    return _mean(_distances(hypotheses.xy_m[:, :BEST_OF, -1:], truth[:, -1:])[..., 0].min(axis=1))


def rmse_at_horizon(hypotheses: Hypotheses, truth: Floats) -> MetricValue:
    """Root mean square of the most probable hypothesis's distance at the horizon, in metres."""
    squared = _mean(_distances(hypotheses.xy_m[:, :1, -1:], truth[:, -1:])[:, 0, 0] ** 2)
    return MetricValue(float(np.sqrt(squared.value)), squared.samples)


def _distances(hypotheses_xy_m: Floats, truth: Floats) -> Floats:
    miss = hypotheses_xy_m - truth[:, None]
    return np.hypot(miss[..., 0], miss[..., 1])


def _mean(values: Floats) -> MetricValue:
    return MetricValue(float(values.mean()) if len(values) else 0.0, len(values))


@dataclass(frozen=True)
class Metric:
    """A metric: its name in results, its heading in tables, and its function."""

    name: str
    label: str
    compute: Callable[[Hypotheses, Floats], MetricValue]


METRICS: Final = (
    Metric("ade_m", "ADE", ade),
    Metric("fde_m", "FDE", fde),
    Metric("min_ade_6_m", "minADE6", min_ade_6),
    Metric("min_fde_6_m", "minFDE6", min_fde_6),
    Metric("rmse_5s_m", "RMSE@5s", rmse_at_horizon),
)
"""Every metric of the evaluation, in the order of reports."""
