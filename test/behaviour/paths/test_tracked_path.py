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
