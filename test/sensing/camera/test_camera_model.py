import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from siren_ros.sensing.specification import map_from_base, optical_from_map
from siren_ros.sensing.suite import load_suite
from siren_ros.simulation.world.measurements import CameraIntrinsics

CAMERA = CameraIntrinsics.centred(800, 600, 335.64)
coordinate = st.floats(-20.0, 20.0)


def test_the_field_of_view_spans_the_outer_edges_of_the_picture():
    camera = load_suite("front").cameras[0].intrinsics
    edge = np.tan(np.radians(50.0))
    uv, depth = camera.project(np.array([[-edge, 0.0, 1.0], [edge, 0.0, 1.0], [0.0, 0.0, 2.0]]))
    assert (uv[0, 0], uv[1, 0]) == (pytest.approx(-0.5), pytest.approx(799.5))
    assert uv[2].tolist() == [399.5, 299.5]
    assert depth.tolist() == [1.0, 1.0, 2.0]


@given(coordinate, coordinate, st.floats(0.2, 100.0))
def test_k_projects_as_the_camera_does(x, y, z):
    uv, _ = CAMERA.project(np.array([x, y, z]))
    homogeneous = CAMERA.matrix @ [x, y, z]
    assert np.allclose(uv, homogeneous[:2] / homogeneous[2])


@given(coordinate, coordinate, st.floats(0.2, 100.0))
def test_the_clip_matrix_puts_points_where_the_camera_projects_them(x, y, z):
    uv, _ = CAMERA.project(np.array([x, y, z]))
    clip = CAMERA.clip_from_optical(0.1, 500.0) @ [x, y, z, 1.0]
    window = (clip[:2] / clip[3] + 1.0) / 2.0 * [800, 600] - 0.5  # OpenGL: pixel centres at half numbers, row 0 first
    assert np.allclose(window, uv, atol=1e-6 * (1 + np.abs(uv).max()))
    assert clip[3] == pytest.approx(z)


def test_rays_through_pixels_come_back_to_them():
    uv, _ = CAMERA.project(CAMERA.pixel_rays().astype(np.float64) * 7.0)
    columns, rows = np.meshgrid(np.arange(800), np.arange(600))
    assert np.allclose(uv[..., 0], columns, atol=1e-3)
    assert np.allclose(uv[..., 1], rows, atol=1e-3)


def test_a_point_to_the_left_of_a_camera_lies_left_in_its_picture():
    ahead_left_above = optical_from_map(map_from_base(5.0, 5.0, 1.0, np.pi / 2)) @ [4.0, 15.0, 2.0, 1.0]
    assert np.allclose(ahead_left_above[:3], [-1.0, -1.0, 10.0])
