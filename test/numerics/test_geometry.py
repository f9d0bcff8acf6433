"""Angles, footprints and distances of boxes."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from siren_ros.numerics.geometry import footprint_corners, overlapping_pairs, rotate, separation_m, wrap_angle


@pytest.mark.parametrize(
    ("angle", "wrapped"),
    [
        (0.0, 0.0),
        (3.0, 3.0),
        (-3.0, -3.0),
        (np.pi, np.pi),
        (-np.pi, np.pi),
        (4.0, 4.0 - 2.0 * np.pi),
        (-4.0, 2.0 * np.pi - 4.0),
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
        (5.0, 0.0, 0.0, 1.0),
        (-5.0, 0.0, 0.0, 1.0),
        (0.0, 3.0, 0.0, 1.0),
        (0.0, -3.0, np.pi, 1.0),
        (3.5, 0.0, 0.0, -0.5),
        (0.0, 1.8, 0.0, -0.2),
        (4.0, 0.0, np.pi / 2.0, 1.0),
        (0.0, 4.0, np.pi / 2.0, 1.0),
        (1.0 + np.sqrt(2.0) * 1.5 + 1.3, 0.0, np.pi / 4.0, 0.3),
    ],
)
def test_the_gap_of_two_boxes_of_4_by_2_m(turn, x, y, yaw, gap):
    at = rotate(np.array([x, y]), turn)
    first, second = boxes((0.0, 0.0, turn, 4.0, 2.0)), boxes((*at, yaw + turn, 4.0, 2.0))
    assert separation_m(first, second)[0] == pytest.approx(gap)
    assert separation_m(second, first)[0] == pytest.approx(gap)


@pytest.mark.parametrize("turn", [0.0, 0.7, -2.0])
def test_of_several_boxes_those_that_overlap_are_found_with_their_depth(turn):
    """Four boxes of 4 by 2 m in a row; the second reaches 0.5 m into the first, the third touches nobody."""
    places = rotate(np.array([[0.0, 0.0], [3.5, 0.0], [8.0, 0.0], [3.5, 1.8]]), turn)
    first, second, depth = overlapping_pairs(*places.T, np.full(4, turn), np.full(4, 4.0), np.full(4, 2.0))
    assert list(zip(first.tolist(), second.tolist(), strict=True)) == [(0, 1), (0, 3), (1, 3)]
    assert depth == pytest.approx([0.5, 0.2, 0.2])


@given(st.floats(-np.pi, np.pi), st.floats(-9.0, 9.0), st.floats(-9.0, 9.0))
def test_a_rotation_turns_counter_clockwise_and_keeps_lengths(angle, x, y):
    turned = rotate(np.array([x, y]), angle)
    expected = (x + 1j * y) * np.exp(1j * angle)
    assert turned == pytest.approx((expected.real, expected.imag), abs=1e-9)
