"""All metrics written out for one sample, one hypothesis and one time after the other; the truth moves."""

import numpy as np
import pytest
from made_scores import scored

from siren_ros.evaluation.prediction.metrics.table import METRIC_OF
from siren_ros.evaluation.prediction.protocol.hypotheses import Hypotheses

SAMPLES, MODES, TIMES = 12, 8, 25


def test_every_sample_has_the_value_of_its_loops() -> None:
    rng = np.random.default_rng(4)
    truth = np.cumsum(rng.normal(0.5, 0.4, (SAMPLES, TIMES, 2)), axis=1) + rng.uniform(-50, 50, (SAMPLES, 1, 2))
    missing = np.cumsum(rng.normal(0.0, 0.8, (SAMPLES, MODES, TIMES, 2)), axis=2)
    hypotheses = Hypotheses.ranked(truth[:, None] + missing, rng.dirichlet(np.ones(MODES), SAMPLES))
    found = {name: METRIC_OF[name].of_samples(hypotheses, scored(truth)) for name in METRIC_OF}
    for sample in range(SAMPLES):
        apart = [
            [float(np.hypot(*(hypotheses.xy_m[sample, mode, time] - truth[sample, time]))) for time in range(TIMES)]
            for mode in range(MODES)
        ]
        six = range(6)
        ends = [apart[mode][TIMES - 1] for mode in six]
        best = ends.index(min(ends))
        whole = sum(float(hypotheses.probability[sample, mode]) for mode in six)
        share = [float(hypotheses.probability[sample, mode]) / whole for mode in six]
        expected = {
            "ade_m": sum(apart[0]) / TIMES,
            "fde_m": ends[0],
            "min_ade_6_m": min(sum(apart[mode]) / TIMES for mode in six),
            "min_fde_6_m": ends[best],
            "rmse_5s_m": ends[0] ** 2,
            "miss_rate_6": float(ends[best] > 2.0),
            "brier_min_fde_6_m": ends[best] + (1.0 - share[best]) ** 2,
            "brier_score": sum((share[mode] - (mode == best)) ** 2 for mode in six),
        }
        assert {name: float(found[name][sample]) for name in expected} == pytest.approx(expected)
    assert set(found["miss_rate_6"]) == {0.0, 1.0}, "both kinds are there"
