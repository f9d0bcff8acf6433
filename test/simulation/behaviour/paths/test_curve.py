import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from siren_ros.simulation.behaviour.paths.curve import Curve


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
