import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from siren_ros.behaviour.config import NavigatorConfig
from siren_ros.behaviour.paths.curve import Curve
from siren_ros.behaviour.paths.lane_path import LaneEnd, LanePath
from siren_ros.behaviour.paths.path_blend import PEAK_CURVATURE, path_onto, quintic_offsets

REFERENCE = LanePath((3,), np.array([0.0]), Curve.through(np.array([[0.0, 0.0], [120.0, 0.0]])), LaneEnd.ROUTE)


@given(start=st.floats(-5, 5), slope=st.floats(-5, 5), end=st.floats(-5, 5))
def test_quintic_meets_its_boundary_conditions(start: float, slope: float, end: float):
    h = 1e-4
    u = np.array([0.0, h, 2 * h, 1.0 - 2 * h, 1.0 - h, 1.0, 1.7])
    d = quintic_offsets(u, start, slope, end)
    assert d[0] == pytest.approx(start)
    assert d[5] == pytest.approx(end)
    assert d[6] == pytest.approx(end)
    assert (d[1] - d[0]) / h == pytest.approx(slope, abs=1e-2)
    assert (d[5] - d[4]) / h == pytest.approx(0.0, abs=1e-2)
    assert (d[2] - 2 * d[1] + d[0]) / h**2 == pytest.approx(0.0, abs=0.5)


def test_peak_curvature_of_a_level_blend():
    u = np.linspace(0.0, 1.0, 2001)
    second = np.gradient(np.gradient(quintic_offsets(u, 0.0, 0.0, 1.0), u), u)
    assert np.abs(second).max() == pytest.approx(PEAK_CURVATURE, rel=1e-3)


def test_path_starts_at_the_pose_and_ends_on_the_offset_line():
    path = path_onto(REFERENCE, (20.0, -3.3, 0.1), 25.0, NavigatorConfig(), offset_m=0.5)
    np.testing.assert_allclose(path.curve.points[0], [20.0, -3.3], atol=1e-9)
    assert path.curve.heading_rad[0] == pytest.approx(0.1, abs=0.03)
    np.testing.assert_allclose(path.curve.points[-1], [120.0, 0.5], atol=1e-6)
    assert path.lane_at(50.0) == 3
    assert np.abs(path.curve.curvature_1pm).max() < 0.06


def test_path_can_be_cut_short_at_its_end():
    path = path_onto(REFERENCE, (20.0, 0.0, 0.0), 25.0, NavigatorConfig(), shorten_m=10.0)
    assert path.curve.points[-1, 0] == pytest.approx(110.0)
