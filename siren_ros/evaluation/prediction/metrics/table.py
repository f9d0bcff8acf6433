"""The table of metrics."""

from collections.abc import Callable
from typing import Final

import numpy as np

from siren_ros.evaluation.prediction.metrics.displacement import ade, fde, min_ade_6, min_fde_6, squared_fde
from siren_ros.evaluation.prediction.metrics.metric import Metric
from siren_ros.evaluation.prediction.metrics.miss_rate import missed_6
from siren_ros.evaluation.prediction.metrics.mode_probability import brier_min_fde_6, brier_score
from siren_ros.evaluation.prediction.metrics.path_collisions import colliding
from siren_ros.evaluation.prediction.protocol.hypotheses import Hypotheses
from siren_ros.evaluation.prediction.protocol.samples import ScoredSamples
from siren_ros.numerics.arrays import Floats


def _by_truth(function: Callable[[Hypotheses, Floats], Floats]) -> Callable[[Hypotheses, ScoredSamples], Floats]:
    return lambda hypotheses, samples: function(hypotheses, samples.future_xy_m)


METRICS: Final = (
    Metric("ade_m", "ADE", _by_truth(ade)),
    Metric("fde_m", "FDE", _by_truth(fde)),
    Metric("min_ade_6_m", "minADE6", _by_truth(min_ade_6)),
    Metric("min_fde_6_m", "minFDE6", _by_truth(min_fde_6)),
    Metric("rmse_5s_m", "RMSE@5s", _by_truth(squared_fde), np.sqrt),
    Metric("miss_rate_6", "MR6", _by_truth(missed_6)),
    Metric("brier_min_fde_6_m", "b-minFDE6", _by_truth(brier_min_fde_6)),
    Metric("brier_score", "Brier", _by_truth(brier_score)),
    Metric("path_collision_rate", "collisions", lambda hypotheses, samples: colliding(hypotheses, samples.batch)),
)
"""Every metric of the evaluation, in the order of reports."""
METRIC_OF: Final = {metric.name: metric for metric in METRICS}
"""By name."""
