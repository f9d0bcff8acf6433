"""Displacement metrics of trajectory prediction (paper, supplement "Evaluation Metrics"); one function for each.

The truth has shape ``(N, T, 2)``; every function gives a value for each sample, shape ``(N,)``.
"""

from typing import Final

import numpy as np

from siren_ros.evaluation.prediction.protocol.hypotheses import Hypotheses
from siren_ros.numerics.arrays import Floats

BEST_OF: Final = 6
"""k of minADE and minFDE; a predictor with fewer hypotheses is scored on those it has."""


def ade(hypotheses: Hypotheses, truth: Floats) -> Floats:
    """Mean distance over time of the most probable hypothesis, in metres."""
    return np.asarray(distances(hypotheses.xy_m[:, :1], truth)[:, 0].mean(axis=-1))


def fde(hypotheses: Hypotheses, truth: Floats) -> Floats:
    """Distance of the most probable hypothesis at the horizon, in metres."""
    return distances(hypotheses.xy_m[:, :1, -1:], truth[:, -1:])[:, 0, 0]


def min_ade_6(hypotheses: Hypotheses, truth: Floats) -> Floats:
    """Least mean distance over time of the six most probable hypotheses, in metres."""
    return np.asarray(distances(hypotheses.xy_m[:, :BEST_OF], truth).mean(axis=-1).min(axis=1))


def min_fde_6(hypotheses: Hypotheses, truth: Floats) -> Floats:
    """Least distance at the horizon of the six most probable hypotheses, in metres."""
    return np.asarray(distances(hypotheses.xy_m[:, :BEST_OF, -1:], truth[:, -1:])[..., 0].min(axis=1))


def squared_fde(hypotheses: Hypotheses, truth: Floats) -> Floats:
    """Square of the most probable hypothesis's distance at the horizon; the root of its mean is RMSE@5s."""
    return np.asarray(fde(hypotheses, truth) ** 2)


def distances(hypotheses_xy_m: Floats, truth: Floats) -> Floats:
    """Distances from the truth, shape ``(N, k, T)`` for hypotheses of shape ``(N, k, T, 2)``."""
    miss = hypotheses_xy_m - truth[:, None]
    return np.asarray(np.hypot(miss[..., 0], miss[..., 1]))
