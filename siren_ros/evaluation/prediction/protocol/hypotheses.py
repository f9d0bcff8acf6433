"""What a predictor answers: several paths for each sample, with their probabilities."""

from dataclasses import dataclass
from typing import Final

import numpy as np

from siren_ros.errors import InputError
from siren_ros.evaluation.prediction.protocol.window import FUTURE_POINTS
from siren_ros.numerics.arrays import Flags, Floats, Rows

SUM_TOLERANCE: Final = 1e-3
"""How far the probabilities of a sample may sum up from 1: models answer in single precision."""


@dataclass(frozen=True)
class Hypotheses:
    """k predicted paths for each of N samples, the most probable first. ``checked`` says what must hold."""

    xy_m: Floats
    """Positions on the common grid, frame ``map``, shape ``(N, k, FUTURE_POINTS, 2)``."""
    probability: Floats
    """Shape ``(N, k)``; of each sample not increasing, and the sum is 1."""

    def __len__(self) -> int:
        return len(self.xy_m)

    @staticmethod
    def certain(xy_m: Floats) -> "Hypotheses":
        """One hypothesis for each sample, from paths of shape ``(N, FUTURE_POINTS, 2)``."""
        return Hypotheses(xy_m[:, None], np.ones((len(xy_m), 1)))

    @staticmethod
    def ranked(xy_m: Floats, probability: Floats) -> "Hypotheses":
        """Sorts hypotheses by their probability, equal ones in the given order, and makes the sum exactly 1.

        Args:
            xy_m: Shape ``(N, k, FUTURE_POINTS, 2)``.
            probability: Shape ``(N, k)``, with positive sums.
        """
        order = np.argsort(-probability, axis=1, kind="stable")
        sorted_probability = np.take_along_axis(probability, order, axis=1)
        return Hypotheses(
            np.take_along_axis(xy_m, order[..., None, None], axis=1),
            sorted_probability / sorted_probability.sum(axis=1, keepdims=True),
        )

    def select(self, samples: Flags | Rows) -> "Hypotheses":
        """Some of the samples, given as a mask or as indices."""
        return Hypotheses(self.xy_m[samples], self.probability[samples])


def checked(model: str, hypotheses: Hypotheses, samples: int) -> Hypotheses:
    """The hypotheses as double precision.

    Raises:
        InputError: A wrong shape, values that are not finite, negative probabilities, probabilities that increase, or
            sums that are not 1; with the number of samples that are wrong, and the first.
    """
    xy_m = np.asarray(hypotheses.xy_m, dtype=np.float64)
    probability = np.asarray(hypotheses.probability, dtype=np.float64)
    shape = xy_m.shape
    if len(shape) != 4 or shape[1] < 1 or (shape[0], *shape[2:]) != (samples, FUTURE_POINTS, 2):
        raise InputError(f"model {model}", shape, f"hypotheses of shape ({samples}, k, {FUTURE_POINTS}, 2)")
    if probability.shape != shape[:2]:
        raise InputError(f"model {model}", probability.shape, f"probabilities of shape {shape[:2]}")
    for wrong, what, allowed in (
        (~np.isfinite(xy_m).all(axis=(1, 2, 3)), "positions that are not finite", "finite values"),
        (~np.isfinite(probability).all(axis=1), "probabilities that are not finite", "finite values"),
        ((probability < 0.0).any(axis=1), "negative probabilities", "0 or more"),
        ((np.diff(probability, axis=1) > 0.0).any(axis=1), "probabilities that increase", "the most probable first"),
        (np.abs(probability.sum(axis=1) - 1.0) > SUM_TOLERANCE, "probabilities of another sum", "a sum of 1"),
    ):
        if wrong.any():
            where = f"{what} in {wrong.sum()} of {samples} samples, first in {int(np.argmax(wrong))}"
            raise InputError(f"model {model}", where, allowed)
    return Hypotheses(xy_m, probability)
