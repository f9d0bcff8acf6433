import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from siren_ros.interfaces.transforms import (
    Odometry,
    Transform,
    from_odometry,
    from_tf,
    matrix_of_quaternion,
    quaternion_of_matrix,
    quaternion_of_yaw,
    to_odometry,
    to_tf,
    yaw_of_quaternion,
)

ANGLES = st.floats(-math.pi + 1e-9, math.pi)


@given(ANGLES)
def test_yaw_survives_the_quaternion(yaw_rad: float) -> None:
    assert yaw_of_quaternion(quaternion_of_yaw(yaw_rad)) == pytest.approx(yaw_rad, abs=1e-9)


@given(ANGLES)
def test_a_yaw_quaternion_turns_x_towards_y(yaw_rad: float) -> None:
    turned = matrix_of_quaternion(quaternion_of_yaw(yaw_rad)) @ [1.0, 0.0, 0.0]
    assert np.allclose(turned, [math.cos(yaw_rad), math.sin(yaw_rad), 0.0])


def test_an_optical_frame_comes_back_as_a_matrix() -> None:
    base_from_optical = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
    assert np.allclose(matrix_of_quaternion(quaternion_of_matrix(base_from_optical)), base_from_optical)


def test_transforms_come_back(round_trip: Callable[[object], Any]) -> None:
    transforms = (
        Transform("map", "base_link", (1.0, -2.0, 0.5), quaternion_of_yaw(0.3)),
        Transform("base_link", "lidar", (0.0, 0.0, 1.93), (0.0, 0.0, 0.0, 1.0)),
    )
    message = round_trip(to_tf(3, transforms))
    assert from_tf(message) == transforms
    assert message.transforms[0].header.stamp.nanosec == 150_000_000


def test_odometry_comes_back_with_its_time(round_trip: Callable[[object], Any]) -> None:
    odometry = Odometry(1.0, 2.0, 0.0, -2.5, 13.9, -0.1, 0.2)
    time_ns, back = from_odometry(round_trip(to_odometry(41, odometry)))
    assert time_ns == 41 * 50_000_000
    assert back.yaw_rad == pytest.approx(odometry.yaw_rad)
    assert (back.x_m, back.forward_mps, back.left_mps, back.yaw_rate_radps) == (1.0, 13.9, -0.1, 0.2)
