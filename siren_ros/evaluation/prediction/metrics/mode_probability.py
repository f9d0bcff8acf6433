"""How good the probabilities of the hypotheses are.

Of a sample, the *best* hypothesis is the one among the six most probable that ends nearest to the truth. The
probabilities of the six are scaled to the sum 1, as Argoverse 2 does.
"""

import numpy as np

from siren_ros.evaluation.prediction.metrics.displacement import BEST_OF, distances
from siren_ros.evaluation.prediction.protocol.hypotheses import Hypotheses
from siren_ros.numerics.arrays import Flags, Floats


def brier_min_fde_6(hypotheses: Hypotheses, truth: Floats) -> Floats:
    """Distance of the best hypothesis at the horizon plus (1 − p)² of its probability: Argoverse 2's ranking metric."""
    best = best_of_six(hypotheses, truth)
    end = distances(hypotheses.xy_m[:, :BEST_OF, -1:], truth[:, -1:])[..., 0]
    return end[best] + (1.0 - probability_of_six(hypotheses)[best]) ** 2


def brier_score(hypotheses: Hypotheses, truth: Floats) -> Floats:
    """Sum of (p − y)² over the six, y 1 for the best and 0 for the others (G. Brier, Mon. Weather Rev. 78 (1950) 1).

    NaN for every sample of a predictor with a single hypothesis: it makes no statement.
    """
    probability = probability_of_six(hypotheses)
    if probability.shape[1] < 2:
        return np.full(len(hypotheses), np.nan)
    return np.asarray(((probability - best_of_six(hypotheses, truth)) ** 2).sum(axis=1))


def probability_of_six(hypotheses: Hypotheses) -> Floats:
    """Probabilities of the six most probable hypotheses, scaled to the sum 1; shape ``(N, min(k, 6))``."""
    first = hypotheses.probability[:, :BEST_OF]
    return np.asarray(first / first.sum(axis=1, keepdims=True))


def best_of_six(hypotheses: Hypotheses, truth: Floats) -> Flags:
    """Which hypothesis of the six is the best, the first of equal ones; one in each row, ``(N, min(k, 6))``."""
    end = distances(hypotheses.xy_m[:, :BEST_OF, -1:], truth[:, -1:])[..., 0]
    return np.asarray(np.arange(end.shape[1]) == end.argmin(axis=1)[:, None])
