"""Angles, footprints and distances of boxes."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from synthetic_episode import rotate

from siren_ros.base.numerics.geometry import (
    Polyline,
    footprint_corners,
    overlapping_pairs,
    separation_m,
    wrap_angle,
)


@pytest.mark.parametrize(
    ("angle", "wrapped"),
    [
        *[(0.0, 0.0), (3.0, 3.0), (-3.0, -3.0), (np.pi, np.pi)],
        *[(-np.pi, np.pi), (4.0, 4.0 - 2.0 * np.pi), (-4.0, 2.0 * np.pi - 4.0)],
    ],
)
def test_angles_are_within_minus_pi_excluded_to_pi(angle, wrapped):
    assert wrap_angle(angle) == pytest.approx(wrapped)
    assert wrap_angle([angle + 6.0 * np.pi])[0] == pytest.approx(wrapped, abs=1e-12) or abs(wrapped) == np.pi


@pytest.mark.parametrize("yaw", [0.0, 0.6, 2.5, -1.9])
def test_corners_go_round_from_the_front_left(yaw):
    along, left = np.array([np.cos(yaw), np.sin(yaw)]), np.array([-np.sin(yaw), np.cos(yaw)])
    (corners,) = footprint_corners(*(np.array([v]) for v in (3.0, -2.0, yaw, 4.0, 1.8)))
    centre = np.array([3.0, -2.0])
    expected = [centre + a * 2.0 * along + b * 0.9 * left for a, b in ((1, 1), (-1, 1), (-1, -1), (1, -1))]
    np.testing.assert_allclose(corners, expected)


def boxes(*rows):
    return footprint_corners(*np.array(rows, dtype=float).T)


@pytest.mark.parametrize("turn", [0.0, 0.7, -2.0])
@pytest.mark.parametrize(
    ("x", "y", "yaw", "gap"),
    [
        *[(5.0, 0.0, 0.0, 1.0), (-5.0, 0.0, 0.0, 1.0), (0.0, 3.0, 0.0, 1.0), (0.0, -3.0, np.pi, 1.0)],
        *[(3.5, 0.0, 0.0, -0.5), (0.0, 1.8, 0.0, -0.2), (4.0, 0.0, np.pi / 2.0, 1.0)],
        *[(0.0, 4.0, np.pi / 2.0, 1.0), (1.0 + np.sqrt(2.0) * 1.5 + 1.3, 0.0, np.pi / 4.0, 0.3)],
    ],
)
def test_the_gap_of_two_boxes_of_4_by_2_m(turn, x, y, yaw, gap):
    at = rotate(np.array([x, y]), turn)
    first, second = boxes((0.0, 0.0, turn, 4.0, 2.0)), boxes((*at, yaw + turn, 4.0, 2.0))
    assert separation_m(first, second)[0] == pytest.approx(gap)
    assert separation_m(second, first)[0] == pytest.approx(gap)


@pytest.mark.parametrize("turn", [0.0, 0.7, -2.0])
def test_of_several_boxes_those_that_overlap_are_found_with_their_depth(turn):
    """Four boxes of 4 by 2 m in a row; the second reaches 0.5 m into the first, the third touches nobody.

    Between two long ones there is a small one, 0.1 m deep in both.
    """
    row = [(0.0, 0.0), (3.5, 0.0), (8.0, 0.0), (3.5, 1.8), (50.0, 0.0), (56.2, 0.0), (62.4, 0.0)]
    places = rotate(np.array(row), turn)
    lengths = np.array([4.0, 4.0, 4.0, 4.0, 12.0, 0.6, 12.0])
    first, second, depth = overlapping_pairs(*places.T, np.full(7, turn), lengths, np.full(7, 2.0))
    assert list(zip(first.tolist(), second.tolist(), strict=True)) == [(0, 1), (0, 3), (1, 3), (4, 5), (5, 6)]
    assert depth == pytest.approx([0.5, 0.2, 0.2, 0.1, 0.1])


POINTS = np.array([[0.0, 0.0], [10.0, 0.0], [10.0, 5.0], [13.0, 9.0]])
LINE = Polyline.through(POINTS)
"""Segments of 10, 5 and 5 m: east, north, and at atan(4/3)."""
LAST = np.arctan2(4.0, 3.0)


@pytest.mark.parametrize(
    ("s", "point", "heading"),
    [
        *[(-2.0, (-2.0, 0.0), 0.0), (0.0, (0.0, 0.0), 0.0), (4.0, (4.0, 0.0), 0.0), (10.0, (10.0, 0.0), np.pi / 2.0)],
        *[(12.0, (10.0, 2.0), np.pi / 2.0), (17.5, (11.5, 7.0), LAST), (25.0, (16.0, 13.0), LAST)],
    ],
)
def test_points_and_headings_at_arc_lengths(s, point, heading):
    assert (LINE.at(s), LINE.heading_rad(s)) == (pytest.approx(point), pytest.approx(heading))
    assert LINE.at([s, s]) == pytest.approx(np.array([point, point]))


@pytest.mark.parametrize(
    ("s", "left", "point"),
    [(4.0, 1.5, (4.0, 1.5)), (12.0, 1.0, (9.0, 2.0)), (12.0, -1.0, (11.0, 2.0)), (17.5, 5.0, (7.5, 10.0))],
)
def test_offsets_are_to_the_left(s, left, point):
    assert LINE.offset_points(s, left) == pytest.approx(point)


@pytest.mark.parametrize(
    ("point", "s", "left"),
    [
        *[((4.0, 1.5), 4.0, 1.5), ((4.0, -1.5), 4.0, -1.5), ((-3.0, 0.5), -3.0, 0.5)],
        *[((9.0, 2.0), 12.0, 1.0), ((11.0, 2.0), 12.0, -1.0), ((16.0, 13.0), 25.0, 0.0)],
        *[((12.0, 14.5), 23.8, 4.1), ((10.5, -0.5), 10.0, -0.5)],
    ],
)
def test_the_nearest_place_of_points(point, s, left):
    found_s, found_left = LINE.project(point)
    assert (found_s, found_left) == pytest.approx((s, left))


def test_many_points_at_once_have_their_own_places():
    s, left = LINE.project(np.array([[[4.0, 1.0], [9.0, 2.0]], [[-1.0, 0.0], [13.0, 9.0]]]))
    assert s == pytest.approx(np.array([[4.0, 12.0], [-1.0, 20.0]]))
    assert left == pytest.approx(np.array([[1.0, 1.0], [0.0, 0.0]]))


@given(turn=st.floats(-np.pi, np.pi), s=st.floats(-5.0, 25.0), left=st.floats(-1.0, 1.0))
def test_a_turned_line_has_the_same_arc_lengths_and_offsets(turn, s, left):
    line = Polyline.through(rotate(POINTS, turn))
    point = LINE.offset_points(s, left)
    assert LINE.project(point) == pytest.approx(line.project(rotate(point, turn)), abs=1e-9)


@pytest.mark.parametrize(
    ("start", "end", "points"),
    [
        *[(2.0, 12.0, [(2.0, 0.0), (10.0, 0.0), (10.0, 2.0)]), (-3.0, 5.0, [(-3.0, 0.0), (0.0, 0.0), (5.0, 0.0)])],
        (12.0, 25.0, [(10.0, 2.0), (10.0, 5.0), (13.0, 9.0), (16.0, 13.0)]),
        *[(10.0, 15.0, [(10.0, 0.0), (10.0, 5.0)]), (2.0, 9.6, [(2.0, 0.0), (9.6, 0.0)])],
        (10.4, 14.7, [(10.0, 0.4), (10.0, 4.7)]),
    ],
)
def test_a_part_keeps_the_corners_in_it(start, end, points):
    part = LINE.cut(start, end)
    assert (part.points, part.length_m) == (pytest.approx(np.array(points)), pytest.approx(end - start))


@pytest.mark.parametrize(("spacing", "count"), [(5.0, 5), (6.0, 5), (20.0, 2), (50.0, 2), (0.5, 41)])
def test_resampled_points_are_equally_far_apart_along_the_line(spacing, count):
    even = LINE.resampled(spacing)
    assert len(even.points) == count
    np.testing.assert_allclose(LINE.project(even.points)[0], np.linspace(0.0, 20.0, count), atol=1e-9)


def test_arc_lengths_add_up_repeated_points_are_dropped_and_parts_joined():
    line = Polyline.through([[0.0, 0.0], [0.0, 0.0], [3.0, 4.0], [3.0, 4.0 + 1e-7], [3.0, 10.0]])
    assert line.arc_m == pytest.approx([0.0, 5.0, 11.0])
    joined = Polyline.joined([Polyline.through(POINTS[:2]), Polyline.through(POINTS[1:])])
    assert joined.points == pytest.approx(POINTS)
    assert (LINE.arc_m.tolist(), LINE.length_m) == ([0.0, 10.0, 15.0, 20.0], 20.0)


@pytest.mark.parametrize(
    "points", [[[1.0, 2.0]], [[1.0, 2.0], [1.0, 2.0]], [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]], [0.0, 1.0]]
)
def test_what_is_no_line_is_refused(points):
    with pytest.raises(ValueError, match=r"shape|distinct"):
        Polyline.through(points)


def test_the_place_near_an_arc_length_where_a_curve_comes_back():
    twice = Polyline.through([[0.0, 0.0], [100.0, 0.0], [100.0, 50.0], [0.0, 50.0], [0.0, 1.0], [100.0, 1.0]])
    point = np.array([[30.0, 0.8]])
    assert twice.project(point)[0][0] == pytest.approx(300.0 - 1.0 + 30.0)  # the second time it comes nearer
    first, second = (30.0, 0.8), (329.0, -0.2)
    for near_m, place in ((20.0, first), (310.0, second), (0.0, first), (-500.0, first), (900.0, second)):
        found = twice.project_near(point, near_m, 60.0)
        np.testing.assert_allclose([found[0][0], found[1][0]], place)
