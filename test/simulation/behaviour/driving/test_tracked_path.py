"""Curves, and paths that lead onto a line."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from siren_ros.simulation.behaviour.driving.tracked_path import (
    PEAK_CURVATURE,
    Curve,
    LaneEnd,
    LanePath,
    Navigation,
    TrackedPath,
    blend_length_m,
    on_reference,
    path_onto,
    quintic_offsets,
)
from siren_ros.simulation.conflicts.yielding import Bends, bend_time_s
from siren_ros.simulation.roads.road_network import NO_LANE


def arc_points(radius, angle=np.pi / 2.0):
    a = np.linspace(0.0, angle, 200)
    return np.stack((radius * np.sin(a), radius * (1.0 - np.cos(a))), axis=-1)


def test_curvature_and_heading_of_a_circle():
    curve = Curve.through(arc_points(20.0))
    assert curve.length_m == pytest.approx(10.0 * np.pi, rel=1e-3)
    np.testing.assert_allclose(curve.curvature_1pm[2:-2], 0.05, rtol=1e-2)
    assert curve.heading_rad[-1] - curve.heading_rad[0] == pytest.approx(np.pi / 2.0, abs=0.06)


def test_smoothing_keeps_ends_and_rounds_the_corner():
    corner = np.array([[0.0, 0.0], [30.0, 0.0], [30.0, -30.0]])
    sharp, smooth = Curve.through(corner), Curve.through(corner, smoothing_m=1.5)
    np.testing.assert_allclose(smooth.points[[0, -1]], corner[[0, -1]], atol=1e-9)
    assert np.abs(smooth.curvature_1pm).max() < 0.7 * np.abs(sharp.curvature_1pm).max()
    assert np.abs(np.linalg.norm(smooth.points - [30.0, 0.0], axis=1)).min() < 1.5


@given(s=st.floats(1.0, 29.0), left=st.floats(-4.0, 4.0))
def test_projection_inverts_offset(s, left):
    curve = Curve.through(arc_points(20.0))
    point = curve.offset_at(np.array([s]), np.array([left]))[0]
    found_s, found_left = curve.project_one(*point)
    assert (found_s, found_left) == (pytest.approx(s, abs=0.05), pytest.approx(left, abs=0.02))
    many_s, many_left, _ = curve.project(point[:1], point[1:])
    assert (many_s[0], many_left[0]) == (pytest.approx(s, abs=0.15), pytest.approx(left, abs=0.08))


def test_goes_straight_on_beyond_its_ends():
    curve = Curve.through(np.array([[0.0, 0.0], [10.0, 0.0]]))
    assert curve.place(-2.0)[:2] == pytest.approx((-2.0, 0.0))
    assert curve.place(13.0)[:2] == pytest.approx((13.0, 0.0))
    assert curve.project_one(14.0, 1.0) == pytest.approx((14.0, 1.0))


def least_time_s(path, from_m, way_m):
    return bend_time_s(Bends(path.times_s, path.curve.spacing_m, from_m), way_m)


CONFIG = Navigation(lateral_accel_mps2=3.0, path_brake_mps2=2.0)
STRAIGHT = Curve.through(np.array([[0.0, 0.0], [100.0, 0.0]]))


def test_speed_falls_to_zero_at_the_end_with_comfortable_braking():
    path = TrackedPath.of(STRAIGHT, CONFIG)
    assert (path.speed_cap_mps(100.0), path.speed_cap_mps(75.0)) == pytest.approx((0.0, 10.0))
    assert TrackedPath.of(STRAIGHT, CONFIG, stop_at_end=False).speed_cap_mps(100.0) > 30.0


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_bend_to_either_side_limits_the_speed_and_is_braked_for_before_it(side):
    a = np.linspace(0.0, np.pi / 2.0, 100)
    bend = np.stack((60.0 + 12.0 * np.sin(a), side * 12.0 * (1.0 - np.cos(a))), axis=-1)
    path = TrackedPath.of(Curve.through(np.concatenate(([[0.0, 0.0]], bend))), CONFIG, stop_at_end=False)
    assert path.speed_cap_mps(70.0) == pytest.approx(6.0, rel=0.05)
    assert path.speed_cap_mps(40.0) == pytest.approx((36.0 + 2.0 * 2.0 * 20.0) ** 0.5, rel=0.1)


def test_the_lane_is_that_of_the_nearest_point_whatever_the_points_distance():
    curve = Curve(np.stack((0.7 * np.arange(31), np.zeros(31)), axis=-1), 0.7, np.zeros(31), np.zeros(31))
    path = TrackedPath.of(curve, CONFIG, np.arange(31, dtype=np.int32))
    assert [path.lane_at(s) for s in (-3.0, 0.0, 0.36, 7.0, 10.2, 21.0, 99.0)] == [0, 0, 1, 10, 15, 30, 30]
    assert path.speed_cap_mps(21.0 - 8.0) == pytest.approx((2.0 * 2.0 * 8.0) ** 0.5)
    assert path.speed_cap_mps(-5.0) == pytest.approx(path.speed_cap_mps(0.0))


def test_the_time_counts_from_the_beginning_whatever_the_points_distance():
    """On a circle at 6 m/s; a path is entered before its beginning at its first point."""
    curve = Curve(np.stack((0.7 * np.arange(31), np.zeros(31)), axis=-1), 0.7, np.zeros(31), np.full(31, 3.0 / 36.0))
    path = TrackedPath.of(curve, CONFIG, stop_at_end=False)
    for from_m, way_m in ((0.0, 0.5), (0.0, 7.0), (0.3, 2.0), (14.0, 30.0)):
        assert least_time_s(path, from_m, way_m) == pytest.approx(way_m / 6.0)
    assert least_time_s(path, -3.0, 5.0) == pytest.approx(2.0 / 6.0)
    assert (least_time_s(path, 3.0, 0.0), least_time_s(path, 3.0, np.inf)) == (0.0, np.inf)


def test_towards_the_end_of_a_path_that_stops_time_goes_on():
    """From 10 m/s with 2 m/s² the last 25 m take 5 s; what is slower than 0.5 m/s counts as that."""
    path = TrackedPath.of(STRAIGHT, CONFIG)
    assert least_time_s(path, 75.0, 25.0) == pytest.approx(5.0, rel=0.1)
    assert least_time_s(path, 100.0, 3.0) == pytest.approx(3.0 / 0.5, rel=0.5)


def test_a_path_that_winds_faster_than_the_steering_follows_is_driven_slowly():
    """Along a clothoid the curvature changes by the same amount each metre."""
    change = 0.01
    s = np.linspace(0.0, 12.0, 400)
    heading = 0.5 * change * s**2
    points = np.cumsum(np.stack((np.cos(heading), np.sin(heading)), axis=-1), axis=0) * s[1]
    slow = Navigation(lateral_accel_mps2=9.0, curvature_rate_1pms=0.03)
    path = TrackedPath.of(Curve.through(points), slow, stop_at_end=False)
    assert path.speed_cap_mps(6.0) == pytest.approx(0.03 / change, rel=0.05)


def test_a_path_without_a_lateral_move_is_settled_from_its_beginning_and_one_without_lanes_has_none():
    path = TrackedPath.of(STRAIGHT, CONFIG)
    assert (path.settled_m, path.lane_at(10.0)) == (0.0, NO_LANE)


REFERENCE = LanePath((3,), np.array([0.0]), Curve.through(np.array([[0.0, 0.0], [120.0, 0.0]])), LaneEnd.ROUTE)


@given(start=st.floats(-5, 5), slope=st.floats(-5, 5), end=st.floats(-5, 5), bend=st.floats(-5, 5))
def test_quintic_meets_its_boundary_conditions(start, slope, end, bend):
    h = 1e-4
    d = quintic_offsets(np.array([0.0, h, 2 * h, 1.0 - 2 * h, 1.0 - h, 1.0, 1.7]), start, slope, end, bend)
    assert (d[0], d[5], d[6]) == (pytest.approx(start), pytest.approx(end), pytest.approx(end))
    assert (d[1] - d[0]) / h == pytest.approx(slope, abs=1e-2)
    assert (d[5] - d[4]) / h == pytest.approx(0.0, abs=1e-2)
    assert (d[2] - 2 * d[1] + d[0]) / h**2 == pytest.approx(bend, abs=0.5)
    assert (d[5] - 2 * d[4] + d[3]) / h**2 == pytest.approx(0.0, abs=0.5)


def test_peak_curvature_of_a_level_blend():
    u = np.linspace(0.0, 1.0, 2001)
    second = np.gradient(np.gradient(quintic_offsets(u, 0.0, 0.0, 1.0), u), u)
    assert np.abs(second).max() == pytest.approx(PEAK_CURVATURE, rel=1e-3)


@pytest.mark.parametrize(("start_m", "end_m"), [(20.0, 110.0), (119.0, 121.0)])
def test_path_can_be_cut_short_at_its_end_and_still_has_two_metres_near_it(start_m, end_m):
    path = path_onto(REFERENCE, (start_m, 0.0, 0.0), 25.0, Navigation(), shorten_m=10.0)
    assert path.curve.points[-1, 0] == pytest.approx(end_m)


@pytest.mark.parametrize("left", [1.0, -1.0])
def test_the_length_of_a_blend_follows_from_time_least_length_and_steering(left):
    config = Navigation(curvature_rate_1pms=0.2)
    assert blend_length_m(left * 3.5, 10.0, 4.0, 6.0, config) == pytest.approx(40.0)
    assert blend_length_m(left * 0.875, 10.0, 4.0, 6.0, config) == pytest.approx(20.0)
    assert blend_length_m(left * 3.5, 1.0, 1.0, 30.0, config) == pytest.approx(30.0)
    assert blend_length_m(left * 7.0, 1.0, 20.0, 0.0, config) == pytest.approx(20.0)
    assert blend_length_m(left * 2.0, 10.0, 0.0, 0.0, config) == pytest.approx((40.0 * 2.0 * 10.0 / 0.2) ** (1 / 3))
    assert blend_length_m(0.0, 10.0, 4.0, 6.0, config) == 3.0


@pytest.mark.parametrize("turned", [0.3, -0.3])
@pytest.mark.parametrize("turn", [0.0, 0.9, 3.1, -3.1, -2.2])
def test_a_blend_beside_a_line_that_points_elsewhere(turn, turned):
    """Headings of poses are within half a turn, those of lines go on."""
    along, across = np.array([np.cos(turn), np.sin(turn)]), np.array([-np.sin(turn), np.cos(turn)])
    curve = Curve.through(np.array([[0.0, 0.0], 120.0 * along]))
    reference = LanePath((3,), np.array([0.0]), curve, LaneEnd.ROUTE)
    start = 20.0 * along + 2.0 * across
    yaw = np.arctan2(np.sin(turn + turned), np.cos(turn + turned))
    path = path_onto(reference, (*start, yaw), 25.0, Navigation(), offset_m=-0.5)
    np.testing.assert_allclose(path.curve.points[0], start, atol=1e-6)
    np.testing.assert_allclose(path.curve.points[-1], 120.0 * along - 0.5 * across, atol=1e-6)
    assert path.lane_at(50.0) == 3
    first = path.curve.points[1] - path.curve.points[0]
    assert first @ across / (first @ along) == pytest.approx(np.tan(turned), abs=0.02)
    assert path.settled_m == 25.0


@pytest.mark.parametrize(("stop", "slow"), [(True, True), (False, False)])
def test_the_line_itself_as_a_path_ends_short_of_its_end_with_or_without_a_stop(stop, slow):
    path = on_reference(REFERENCE, Navigation(), stop_at_end=stop, shorten_m=7.0)
    assert path.length_m == pytest.approx(113.0)
    assert (path.speed_cap_mps(113.0) < 0.1) is slow
    assert on_reference(REFERENCE, Navigation(), stop_at_end=True, shorten_m=200.0).length_m == pytest.approx(2.0)


@pytest.mark.parametrize(("turned", "slope"), [(0.5, np.tan(0.5)), (0.8, 0.6), (1.4, 0.6), (-0.8, -0.6), (-1.4, -0.6)])
def test_a_blend_begins_no_steeper_than_0_6(turned, slope):
    path = path_onto(REFERENCE, (20.0, 0.0, turned), 60.0, Navigation())
    first = path.curve.points[1] - path.curve.points[0]
    assert first[1] / first[0] == pytest.approx(slope, abs=0.02)
