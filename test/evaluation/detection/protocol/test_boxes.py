"""Attributes at their limit, and tables of boxes put together and taken apart."""

import numpy as np
import pytest
from detection_boxes import made_boxes

from siren_ros.evaluation.detection.protocol.boxes import attributes_of, joined


@pytest.mark.parametrize("turn_rad", [0.0, 2.0, -1.0])
def test_a_vehicle_moves_above_three_tenths_of_a_metre_a_second(turn_rad: float) -> None:
    speed = np.array([0.0, 0.29, 0.31, 20.0])[:, None]
    codes = attributes_of(speed * np.array([np.cos(turn_rad), np.sin(turn_rad)]))
    assert codes.tolist() == [2, 2, 1, 1]
    assert attributes_of(np.array([[0.0, np.nan], [np.nan, 5.0]])).tolist() == [0, 0]


def test_tables_are_joined_in_their_order_and_rows_keep_together() -> None:
    first, second = (made_boxes([], places, scores)[1] for places, scores in (([1.0, 2.0], [0.1, 0.2]), ([3.0], [0.3])))
    whole = joined([first, second])
    assert len(whole) == 3
    assert whole.centre_m[:, 0].tolist() == [1.0, 2.0, 3.0]
    some = whole.at(np.array([2, 0]))
    assert (some.centre_m[:, 0].tolist(), some.score.tolist()) == ([3.0, 1.0], [0.3, 0.1])
    assert whole.at(np.array([False, True, False])).score.tolist() == [0.2]
