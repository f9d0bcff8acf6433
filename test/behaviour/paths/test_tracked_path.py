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
