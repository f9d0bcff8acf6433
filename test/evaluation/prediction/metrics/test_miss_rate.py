import numpy as np

from siren_ros.evaluation.prediction.metrics.miss_rate import missed_6
from siren_ros.evaluation.prediction.protocol.hypotheses import Hypotheses


def test_a_hypothesis_within_two_metres_is_no_miss() -> None:
    paths = np.zeros((4, 7, 25, 2))
    paths[..., 0] = 10.0
    paths[1, 5, -1] = (0.0, 2.0)
    paths[2, 5, -1] = (0.0, 2.0 + 1e-9)
    paths[3, 6, -1] = (0.0, 0.0)
    hypotheses = Hypotheses.ranked(paths, np.ones((4, 7)))
    assert missed_6(hypotheses, np.zeros((4, 25, 2))).tolist() == [1.0, 0.0, 1.0, 1.0], "the seventh does not count"
