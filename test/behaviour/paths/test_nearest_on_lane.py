import numpy as np
import pytest

from siren_ros.behaviour.paths.nearest_on_lane import lane_heading, nearest_on_lane
from siren_ros.numerics.polyline import Polyline


@pytest.mark.parametrize(
    "point",
    [
        (-5.0, 2.0),
        (12.5, 25.0),
        (6.0, -1.0),
        (-9.0, -20.0),
        (30.0, 15.1),
        (4.0, 1.0),
        (9.0, 0.5),
        (11.0, 3.0),
        (12.0, 20.0),
    ],
)
def test_nearest_place_agrees_with_the_polyline(point):
    line = Polyline.through(np.array([[0.0, 0.0], [10.0, 0.0], [12.0, 6.0], [12.0, 15.0]]))
    s, left, heading = nearest_on_lane(line, *point)
    expected_s, expected_left = line.project(point)
    assert (s, left) == pytest.approx((float(expected_s), float(expected_left)))
    if 0.1 < s < line.length_m - 0.1 and min(abs(s - line.arc_m)) > 0.01:
        assert heading == pytest.approx(float(line.heading_rad(s)))
    assert lane_heading(line, 11.0) == pytest.approx(float(line.heading_rad(11.0)))


@pytest.mark.parametrize(("s", "heading"), [(-3.0, 0.0), (5.0, 0.0), (13.0, np.arctan2(6.0, 2.0)), (20.0, np.pi / 2.0)])
def test_the_heading_at_an_arc_length_is_that_of_its_segment(s, heading):
    line = Polyline.through(np.array([[0.0, 0.0], [10.0, 0.0], [12.0, 6.0], [12.0, 15.0]]))
    assert lane_heading(line, s) == pytest.approx(heading)
    assert lane_heading(line, 99.0) == pytest.approx(np.pi / 2.0)


def test_the_last_segment_goes_straight_on():
    line = Polyline.through(np.array([[0.0, 0.0], [10.0, 0.0], [10.0, 5.0]]))
    s, left, heading = nearest_on_lane(line, 7.0, 12.0)
    assert (s, left, heading) == pytest.approx((22.0, 3.0, np.pi / 2.0))
    s, left, heading = nearest_on_lane(line, -4.0, -2.0)
    assert (s, left, heading) == pytest.approx((-4.0, -2.0, 0.0))
