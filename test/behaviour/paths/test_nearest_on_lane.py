import numpy as np
import pytest

from siren_ros.behaviour.paths.nearest_on_lane import lane_heading, nearest_on_lane
from siren_ros.numerics.polyline import Polyline


@pytest.mark.parametrize("point", [(-5.0, 2.0), (4.0, 1.0), (9.0, 0.5), (11.0, 3.0), (12.0, 20.0)])
def test_nearest_place_agrees_with_the_polyline(point):
    line = Polyline.through(np.array([[0.0, 0.0], [10.0, 0.0], [12.0, 6.0], [12.0, 15.0]]))
    s, left, heading = nearest_on_lane(line, *point)
    expected_s, expected_left = line.project(point)
    assert (s, left) == pytest.approx((float(expected_s), float(expected_left)))
    if 0.1 < s < line.length_m - 0.1 and min(abs(s - line.arc_m)) > 0.01:
        assert heading == pytest.approx(float(line.heading_rad(s)))
    assert lane_heading(line, 11.0) == pytest.approx(float(line.heading_rad(11.0)))
