"""Calibration: hypotheses with probability p should be the best ones in a share p of the cases."""

from dataclasses import dataclass
from typing import Final

import numpy as np

from siren_ros.evaluation.prediction.metrics.metric import MetricValue
from siren_ros.evaluation.prediction.metrics.mode_probability import best_of_six, probability_of_six
from siren_ros.evaluation.prediction.protocol.hypotheses import Hypotheses
from siren_ros.numerics.arrays import Floats

BINS: Final = 10
"""Of equal width over probabilities from 0 to 1."""


@dataclass(frozen=True)
class Reliability:
    """Counts over bins of the probability; arrays of shape ``(BINS,)``. Counts of several episodes add up."""

    count: Floats
    """Hypotheses in each bin."""
    probability: Floats
    """Sum of their probabilities."""
    best: Floats
    """How many of them were the best of their sample."""

    def __add__(self, other: "Reliability") -> "Reliability":
        return Reliability(self.count + other.count, self.probability + other.probability, self.best + other.best)


def no_reliability() -> Reliability:
    """Without any hypothesis."""
    return Reliability(np.zeros(BINS), np.zeros(BINS), np.zeros(BINS))


def reliability_of(hypotheses: Hypotheses, truth: Floats) -> Reliability:
    """Counts the six most probable hypotheses of each sample; a single hypothesis is no statement and not counted.

    Nor are hypotheses of probability 0, which fill up samples with fewer ones.
    """
    probability = probability_of_six(hypotheses)
    if probability.shape[1] < 2:
        return no_reliability()
    there = probability > 0.0
    stated, best = probability[there], best_of_six(hypotheses, truth)[there]
    place = np.minimum((stated * BINS).astype(np.intp), BINS - 1)
    count, total, hits = (
        np.bincount(place, weights=weights, minlength=BINS).astype(np.float64)
        for weights in (np.ones(len(stated)), stated, best.astype(np.float64))
    )
    return Reliability(count, total, hits)


def calibration_error(reliability: Reliability) -> MetricValue:
    """Mean distance between stated probability and frequency, weighted by the bins' counts.

    The "expected calibration error" of M. Naeini, G. Cooper, M. Hauskrecht, AAAI 2015.
    """
    total = float(reliability.count.sum())
    error = np.abs(reliability.probability - reliability.best).sum() / total if total else 0.0
    return MetricValue(float(error), int(total))
