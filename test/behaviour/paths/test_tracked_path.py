import numpy as np
import pytest

from siren_ros.behaviour.config import NavigatorConfig
from siren_ros.behaviour.paths.curve import Curve
from siren_ros.behaviour.paths.tracked_path import TrackedPath
from siren_ros.roads.road_network import NO_LANE

CONFIG = NavigatorConfig(lateral_accel_mps2=3.0, path_brake_mps2=2.0)
STRAIGHT = Curve.through(np.array([[0.0, 0.0], [100.0, 0.0]]))


def test_speed_falls_to_zero_at_the_end_with_comfortable_braking():
    path = TrackedPath.of(STRAIGHT, CONFIG)
    assert path.speed_cap_mps(100.0) == pytest.approx(0.0)
    assert path.speed_cap_mps(75.0) == pytest.approx(10.0)
    assert TrackedPath.of(STRAIGHT, CONFIG, stop_at_end=False).speed_cap_mps(100.0) > 30.0


def test_curve_limits_the_speed_and_is_braked_for_before_it():
    a = np.linspace(0.0, np.pi / 2.0, 100)
    bend = np.stack((60.0 + 12.0 * np.sin(a), 12.0 * (1.0 - np.cos(a))), axis=-1)
    path = TrackedPath.of(Curve.through(np.concatenate(([[0.0, 0.0]], bend))), CONFIG, stop_at_end=False)
    assert path.speed_cap_mps(70.0) == pytest.approx(6.0, rel=0.05)
    assert path.speed_cap_mps(40.0) == pytest.approx((36.0 + 2.0 * 2.0 * 20.0) ** 0.5, rel=0.1)


def test_lane_below_the_path():
    lanes = np.repeat(np.array([4, 7], dtype=np.int32), [50, 51])
    path = TrackedPath.of(STRAIGHT, CONFIG, lanes)
    assert (path.lane_at(10.0), path.lane_at(90.0), path.lane_at(500.0)) == (4, 7, 7)
    assert TrackedPath.of(STRAIGHT, CONFIG).lane_at(10.0) == NO_LANE


def test_the_lane_is_that_of_the_nearest_point_whatever_the_points_distance():
    curve = Curve(np.stack((0.7 * np.arange(31), np.zeros(31)), axis=-1), 0.7, np.zeros(31), np.zeros(31))
    path = TrackedPath.of(curve, CONFIG, np.arange(31, dtype=np.int32))
    assert [path.lane_at(s) for s in (-3.0, 0.0, 0.36, 7.0, 10.2, 21.0, 99.0)] == [0, 0, 1, 10, 15, 30, 30]
    assert path.speed_cap_mps(21.0 - 8.0) == pytest.approx((2.0 * 2.0 * 8.0) ** 0.5)
    assert path.speed_cap_mps(-5.0) == pytest.approx(path.speed_cap_mps(0.0))


def test_a_way_takes_at_least_the_time_at_the_speed_of_its_bends():
    a = np.linspace(0.0, 2.5, 200)
    circle = np.stack((25.0 * np.sin(a), 25.0 * (1.0 - np.cos(a))), axis=-1)
    path = TrackedPath.of(Curve.through(circle), CONFIG, stop_at_end=False)
    assert path.least_time_s(20.0, 12.0) == pytest.approx(12.0 / 75.0**0.5, rel=0.02)
    assert path.least_time_s(20.0, 0.0) == 0.0
    parts = path.least_time_s(20.0, 5.0) + path.least_time_s(25.0, 7.0)
    assert parts == pytest.approx(path.least_time_s(20.0, 12.0))
    assert path.least_time_s(20.0, np.inf) == np.inf
    ends = path.length_m
    assert path.least_time_s(ends, 20.0) == pytest.approx(2.0 * path.least_time_s(ends, 10.0)), (
        "beyond its end as before"
    )
    assert path.least_time_s(ends, 10.0) == pytest.approx(10.0 / path.speed_cap_mps(ends), rel=0.15)


def test_the_time_counts_from_the_beginning_whatever_the_points_distance():
    """On a circle at 6 m/s; a path is entered before its beginning at its first point."""
    curve = Curve(np.stack((0.7 * np.arange(31), np.zeros(31)), axis=-1), 0.7, np.zeros(31), np.full(31, 3.0 / 36.0))
    path = TrackedPath.of(curve, CONFIG, stop_at_end=False)
    for from_m, way_m in ((0.0, 0.5), (0.0, 7.0), (0.3, 2.0), (14.0, 30.0)):
        assert path.least_time_s(from_m, way_m) == pytest.approx(way_m / 6.0)
    assert path.least_time_s(-3.0, 5.0) == pytest.approx(2.0 / 6.0)


def test_towards_the_end_of_a_path_that_stops_time_goes_on():
    """From 10 m/s with 2 m/s² the last 25 m take 5 s; what is slower than 0.5 m/s counts as that."""
    path = TrackedPath.of(STRAIGHT, CONFIG)
    assert path.least_time_s(75.0, 25.0) == pytest.approx(5.0, rel=0.1)
    assert path.least_time_s(100.0, 3.0) == pytest.approx(3.0 / 0.5, rel=0.5)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_bends_to_both_sides_limit_the_speed_by_the_lateral_acceleration(side):
    a = np.linspace(0.0, 2.5, 200)
    circle = np.stack((25.0 * np.sin(a), side * 25.0 * (1.0 - np.cos(a))), axis=-1)
    path = TrackedPath.of(Curve.through(circle), CONFIG, stop_at_end=False)
    assert path.speed_cap_mps(30.0) == pytest.approx((3.0 * 25.0) ** 0.5, rel=0.02)


def test_a_path_that_winds_faster_than_the_steering_follows_is_driven_slowly():
    """Along a clothoid the curvature changes by the same amount each metre."""
    change = 0.01
    s = np.linspace(0.0, 12.0, 400)
    heading = 0.5 * change * s**2
    points = np.cumsum(np.stack((np.cos(heading), np.sin(heading)), axis=-1), axis=0) * s[1]
    slow = NavigatorConfig(lateral_accel_mps2=9.0, curvature_rate_1pms=0.03)
    path = TrackedPath.of(Curve.through(points), slow, stop_at_end=False)
    assert path.speed_cap_mps(6.0) == pytest.approx(0.03 / change, rel=0.05)


def test_a_path_without_a_lateral_move_is_settled_from_its_beginning():
    assert TrackedPath.of(STRAIGHT, CONFIG).settled_m == 0.0
