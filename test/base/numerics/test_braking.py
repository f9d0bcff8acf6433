"""Speeds in bends and before them, in closed form."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from known_outputs import assert_known

from siren_ros.base.numerics import braking
from siren_ros.base.numerics.geometry import Polyline


def circle(radius_m, turn_rad):
    angle = np.linspace(0.0, turn_rad, int(turn_rad * radius_m / 0.2) + 2)
    return Polyline.through(np.stack((radius_m * np.sin(angle), radius_m * (1.0 - np.cos(angle))), axis=-1))


@pytest.mark.parametrize("radius_m", [6.0, 15.0, 80.0])
def test_a_circle_is_driven_at_the_root_of_acceleration_times_radius(radius_m):
    path = circle(radius_m, 1.5)
    middle = np.array([path.length_m / 2.0])
    assert braking.curvature_1pm(path, middle)[0] == pytest.approx(1.0 / radius_m, rel=0.05)
    speeds = braking.bend_speeds_mps(path, 3.0)
    assert speeds[len(speeds) // 2] == pytest.approx(np.sqrt(3.0 * radius_m), rel=0.05)


@pytest.mark.parametrize("corner_m", [0.5, 10.0, 19.5])
def test_a_corner_near_an_end_of_a_path_bends_it_no_more_than_elsewhere(corner_m):
    turned = 0.3
    end = corner_m + (20.0 - corner_m) * np.cos(turned), (20.0 - corner_m) * np.sin(turned)
    path = Polyline.through([[0.0, 0.0], [corner_m, 0.0], end])
    curvature = braking.curvature_1pm(path, np.arange(0.0, 20.0, 0.25))
    assert curvature.max() == pytest.approx(turned / 4.0)


@pytest.mark.parametrize("way_m", [1.0, 3.0, 20.0])
def test_corners_to_both_sides_slow_down_as_each_alone_does(way_m):
    """A lane goes aside and on again: the headings before and behind are one."""
    turned, ahead = 0.5, np.array([1.0, 0.0])
    aside = np.array([np.cos(turned), np.sin(turned)])
    path = Polyline.through(np.cumsum([(0.0, 0.0), 10.0 * ahead, way_m * aside, 10.0 * ahead], axis=0))
    speeds = braking.bend_speeds_mps(path, 3.0)
    assert speeds.min() == pytest.approx(np.sqrt(3.0 / (0.5 * turned)), rel=1e-6)
    assert speeds[:8].min() > 1e3
    slow = speeds[9 : 12 + round(way_m)] < 1e3
    assert slow[:3].all(), "within a metre of the first corner"
    assert slow[-3:].all(), "and of the second"


def test_braking_before_a_bend_is_as_strong_as_it_may_be_and_no_stronger():
    target = np.full(101, 20.0)
    target[60:] = 5.0
    speeds = braking.with_braking(target, 2.0)
    assert (speeds[60], speeds[0]) == (5.0, pytest.approx(np.sqrt(5.0**2 + 2.0 * 2.0 * 60.0)))
    assert np.all(np.diff(speeds[:61] ** 2) >= -2.0 * 2.0 - 1e-9)
    assert braking.squares_with_braking(target**2, 2.0, 1.0) == pytest.approx(speeds**2)


@pytest.mark.parametrize(("way_m", "stops"), [(7.1, False), (7.3, True)])
def test_from_6_mps_with_2_5_mps2_a_vehicle_stops_within_7_2_m(way_m, stops):
    assert braking.stops_within(36.0, 2.5, way_m) is stops


@given(st.lists(st.floats(0.5, 40.0), min_size=1, max_size=60), st.floats(0.0, 30.0), st.floats(0.1, 5.0))
def test_profiles_never_exceed_the_speeds_that_they_keep_to(target, first_mps, accel_mps2):
    limits = np.array(target)
    braked = braking.with_braking(limits, accel_mps2)
    before = braked.copy()
    reached = braking.with_accelerating(braked, first_mps, accel_mps2)
    assert (limits.tolist(), braked.tolist()) == (target, before.tolist())
    assert np.all(reached <= braked)
    assert np.all(braked <= limits)
    assert reached[0] <= first_mps
    assert np.all(np.abs(np.diff(reached**2)) <= 2.0 * accel_mps2 + 1e-6)


def test_speeding_up_follows_the_constant_acceleration_up_to_the_speeds_allowed():
    speeds = braking.with_accelerating(np.full(101, 15.0), 5.0, 1.5)
    assert speeds == pytest.approx(np.minimum(15.0, np.sqrt(25.0 + 2.0 * 1.5 * np.arange(101.0))))
    assert braking.with_accelerating(np.full(3, 4.0), 5.0, 1.5).tolist() == [4.0, 4.0, 4.0]
    assert braking.bend_speeds_mps(Polyline.through([[0.0, 0.0], [100.0, 0.0]]), 3.0).min() > 1e3


def test_places_projections_and_speeds_of_a_crooked_way() -> None:
    """Corners to both sides, one of them sharp, and points around it, before it and behind it."""
    path = Polyline.through([(3.0, 1.0), (3.0, 1.0), (9.0, 4.0), (12.0, 12.0), (11.0, 20.0), (2.0, 17.0), (-6.0, 30.0)])
    arc_m = np.linspace(-4.0, path.length_m + 4.0, 9)
    points = np.column_stack((8.0 * np.sin(np.arange(9.0)) + 5.0, 3.0 * np.arange(9.0)))
    speeds = braking.bend_speeds_mps(path, 3.0).clip(max=20.0)
    found = {
        "length": path.length_m,
        "at": path.at(arc_m),
        "heading": path.heading_rad(arc_m),
        "offset": path.offset_points(arc_m, np.linspace(-2.0, 2.0, 9)),
        "project": np.column_stack(path.project(points)),
        "near": np.column_stack(path.project_near(points, 20.0, 6.0)),
        "cut": [path.cut(*ends).points for ends in ((-2.0, 10.0), (8.0, 30.0), (40.0, 60.0))],
        "resampled": path.resampled(9.0).points,
        "joined": Polyline.joined([path.cut(0.0, 10.0), path.cut(10.0, 20.0)]).arc_m,
        "curvature": braking.curvature_1pm(path, arc_m),
        "bends": speeds,
        "braking": braking.with_braking(speeds, 2.0),
        "squares": np.sqrt(braking.squares_with_braking(speeds**2, 2.0, 1.0)),
        "accelerating": braking.with_accelerating(speeds, 3.0, 1.5),
        "following": [braking.safe_following_mps(lead, free, 3.0, 1.2) for lead in (0.0, 8.0) for free in (0.0, 15.0)],
    }
    assert_known(Path(__file__).parent / "known" / "ways.json", found)
