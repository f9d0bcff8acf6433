"""Miss rate: how often none of the hypotheses ends near the truth."""

from typing import Final

import numpy as np

from siren_ros.evaluation.prediction.metrics.displacement import min_fde_6
from siren_ros.evaluation.prediction.protocol.hypotheses import Hypotheses
from siren_ros.numerics.arrays import Floats

MISS_M: Final = 2.0
"""Argoverse 2's threshold."""


def missed_6(hypotheses: Hypotheses, truth: Floats) -> Floats:
    """1 where each of the six most probable hypotheses ends more than 2 m from the truth, else 0; shape ``(N,)``."""
    return np.asarray(min_fde_6(hypotheses, truth) > MISS_M, dtype=np.float64)
