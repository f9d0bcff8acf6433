"""Which drivers of SUMO keep to the side of their lane."""

import numpy as np
import pytest

from siren_ros.traffic.sumo.rescue_lane import ENDS_ABOVE_MPS, FORMS_BELOW_MPS, kept_sides

LEFT, RIGHT, MIDDLE = 1, -1, 0


def sides(*values: int) -> np.ndarray:
    return np.array(values, np.int8)


@pytest.mark.parametrize("side", [LEFT, RIGHT])
def test_slow_drivers_keep_to_the_side_of_their_lane(side):
    speeds = np.array([0.0, FORMS_BELOW_MPS - 0.01, FORMS_BELOW_MPS + 0.01])
    kept = kept_sides(sides(side, side, side), sides(0, 0, 0), speeds)
    assert kept.tolist() == [side, side, MIDDLE]


def test_who_keeps_to_the_side_goes_back_when_traffic_flows():
    speeds = np.array([FORMS_BELOW_MPS + 0.01, ENDS_ABOVE_MPS - 0.01, ENDS_ABOVE_MPS + 0.01])
    assert kept_sides(sides(1, 1, 1), sides(1, 1, 1), speeds).tolist() == [LEFT, LEFT, MIDDLE]


def test_who_changes_lanes_changes_sides_and_towns_have_none():
    assert kept_sides(sides(LEFT, MIDDLE), sides(RIGHT, RIGHT), np.array([1.0, 1.0])).tolist() == [LEFT, MIDDLE]
