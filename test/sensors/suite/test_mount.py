import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from siren_ros.sensors.suite.mount import OPTICAL_FROM_BODY, Mount, inverse, map_from_base, rotation_from_rpy

angles = st.floats(-3.0, 3.0)


@given(angles, angles, angles)
def test_rotations_are_proper(roll: float, pitch: float, yaw: float) -> None:
    rotation = rotation_from_rpy(roll, pitch, yaw)
    assert np.allclose(rotation @ rotation.T, np.eye(3))
    assert np.linalg.det(rotation) == pytest.approx(1.0)


@given(angles, angles, angles)
def test_inverse_undoes_a_transform(roll: float, pitch: float, yaw: float) -> None:
    mount = Mount(1.0, -2.0, 3.0, yaw, pitch, roll)
    assert np.allclose(inverse(mount.base_from_sensor) @ mount.base_from_sensor, np.eye(4))


def test_yaw_turns_left_pitch_looks_down_roll_lowers_the_right_side() -> None:
    forward, left = np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])
    assert np.allclose(rotation_from_rpy(0, 0, np.pi / 2) @ forward, [0, 1, 0])
    assert (rotation_from_rpy(0, 0.1, 0) @ forward)[2] < 0
    assert (rotation_from_rpy(0.1, 0, 0) @ left)[2] > 0


def test_a_point_ahead_of_an_actor_heading_north_lies_north() -> None:
    pose = map_from_base(10.0, 20.0, 0.5, np.pi / 2)
    assert np.allclose(pose @ [2.0, 0.0, 1.0, 1.0], [10.0, 22.0, 1.5, 1.0])


def test_the_optical_frame_has_z_forward_x_right_y_down() -> None:
    assert np.allclose(OPTICAL_FROM_BODY @ [1.0, 0.0, 0.0], [0, 0, 1])
    assert np.allclose(OPTICAL_FROM_BODY @ [0.0, 1.0, 0.0], [-1, 0, 0])
    assert np.allclose(OPTICAL_FROM_BODY @ [0.0, 0.0, 1.0], [0, -1, 0])
