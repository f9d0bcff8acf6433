import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from siren_ros.data.interfaces.topics import ODOMETRY, TF
from siren_ros.data.interfaces.transforms import (
    Transform,
    from_odometry,
    from_tf,
    matrix_between,
    matrix_of_quaternion,
    quaternion_of_matrix,
    quaternion_of_yaw,
    to_odometry,
    to_tf,
    yaw_of_quaternion,
)
from siren_ros.errors import InputError
from siren_ros.sensing.specification import rotation_from_rpy
from siren_ros.simulation.world.carrier import Odometry

ANGLES = st.floats(-math.pi + 1e-9, math.pi)


@given(ANGLES)
def test_yaw_survives_the_quaternion(yaw_rad):
    assert yaw_of_quaternion(quaternion_of_yaw(yaw_rad)) == pytest.approx(yaw_rad, abs=1e-9)


@given(ANGLES)
def test_a_yaw_quaternion_turns_x_towards_y(yaw_rad):
    turned = matrix_of_quaternion(quaternion_of_yaw(yaw_rad)) @ [1.0, 0.0, 0.0]
    assert np.allclose(turned, [math.cos(yaw_rad), math.sin(yaw_rad), 0.0])


def test_an_optical_frame_comes_back_as_a_matrix():
    base_from_optical = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
    assert np.allclose(matrix_of_quaternion(quaternion_of_matrix(base_from_optical)), base_from_optical)


def test_transforms_come_back(round_trip):
    transforms = (
        Transform("map", "base_link", (1.0, -2.0, 0.5), quaternion_of_yaw(0.3)),
        Transform("base_link", "lidar", (0.0, 0.0, 1.93), (0.0, 0.0, 0.0, 1.0)),
    )
    message = round_trip(to_tf(3, transforms), TF.type_name)
    assert (from_tf(message), message.transforms[0].header.stamp.nanosec) == (transforms, 150_000_000)


def test_transforms_are_chained_through_the_frames_between():
    chain = (
        Transform("odom", "base_link", (2.0, 0.0, 0.0), quaternion_of_yaw(0.5)),
        Transform("map", "odom", (10.0, 20.0, 1.0), quaternion_of_yaw(math.pi / 2.0)),
    )
    map_from_base = matrix_between(chain, "map", "base_link")
    assert np.allclose(map_from_base[:3, 3], [10.0, 22.0, 1.0])
    assert np.allclose(map_from_base[:2, 0], [math.cos(math.pi / 2.0 + 0.5), math.sin(math.pi / 2.0 + 0.5)])
    assert np.array_equal(matrix_between(chain, "map", "map"), np.eye(4))
    for circle in (chain[:1], (Transform("base_link", "base_link", (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0)),)):
        with pytest.raises(InputError, match="chain of transforms from map"):
            matrix_between(circle, "map", "base_link")


def test_odometry_comes_back_with_its_time(round_trip):
    pose = np.array([[4.0, 0.1, 0.2], [0.1, 5.0, 0.3], [0.2, 0.3, 6.0]])
    odometry = Odometry(1.0, 2.0, -2.5, 13.9, -0.1, 0.2, pose, 0.1 * pose)
    message = round_trip(to_odometry(41, odometry, "av/odom", "av/base_link"), ODOMETRY.type_name)
    time_ns, back = from_odometry(message)
    assert time_ns == 41 * 50_000_000
    assert (message.header.frame_id, message.child_frame_id) == ("av/odom", "av/base_link")
    assert back.yaw_rad == pytest.approx(odometry.yaw_rad)
    assert (back.x_m, back.y_m, back.forward_mps, back.left_mps, back.yaw_rate_radps) == (1.0, 2.0, 13.9, -0.1, 0.2)
    assert np.array_equal(back.pose_covariance, pose)
    assert np.array_equal(back.twist_covariance, 0.1 * pose)
    place, speed, turn = message.pose.pose.position, message.twist.twist.linear, message.twist.twist.angular
    assert (place.x, place.y, place.z, speed.z, turn.x, turn.y) == (1.0, 2.0, 0.0, 0.0, 0.0, 0.0), "on the plane"
    full = np.array(message.pose.covariance).reshape(6, 6)  # x, y, z, and rotations about x, y, z (REP 103)
    assert (full[0, 1], full[0, 5], full[5, 5]) == (0.1, 0.2, 6.0)
    assert np.all(np.linalg.eigvalsh(full) > 0.0)


@given(ANGLES, st.floats(-1.4, 1.4), ANGLES)
def test_the_yaw_of_a_tilted_body_is_that_of_its_x_axis_on_the_ground(yaw, pitch, roll):
    quaternion = quaternion_of_matrix(rotation_from_rpy(roll, pitch, yaw))
    ahead = matrix_of_quaternion(quaternion)[:, 0]
    difference = yaw_of_quaternion(quaternion) - math.atan2(ahead[1], ahead[0])
    assert math.remainder(difference, 2.0 * math.pi) == pytest.approx(0.0, abs=1e-6)
