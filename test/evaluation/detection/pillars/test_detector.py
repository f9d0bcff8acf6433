"""What stays of boxes that lie on each other."""

import numpy as np

from siren_ros.evaluation.detection.pillars.detector import apart


def test_the_more_confident_of_near_boxes_stays() -> None:
    centre = np.array([[0.0, 0.0], [1.0, 0.0], [2.5, 0.0], [2.5, 3.0]])
    assert apart(centre, np.array([0.5, 0.9, 0.4, 0.1]), 1.8).tolist() == [False, True, False, True]
    assert apart(centre, np.array([0.5, 0.2, 0.4, 0.1]), 1.8).tolist() == [True, False, True, True]


def test_nothing_stays_of_nothing() -> None:
    assert apart(np.zeros((0, 2)), np.zeros(0), 1.0).shape == (0,)
