"""Frames of a carrier: whatever the odometry says, ``map`` to ``odom`` to ``base_link`` is the simulated pose."""

import numpy as np
import pytest
from hand_made_record import actor_states
from hypothesis import given
from hypothesis import strategies as st

from siren_ros.data.interfaces.measurements import Transform, matrix_of_quaternion
from siren_ros.data.sensor_messages.sensor_topics import AV, EMV, frames_of, motion_of, noise_seed, row_of_carrier
from siren_ros.sensing.navigation import VehicleMotion
from siren_ros.sensing.specification import map_from_base, transform
from siren_ros.simulation.world.carrier import Odometry

places, angles = st.floats(-500.0, 500.0), st.floats(-3.1, 3.1)


def matrix(link: Transform) -> np.ndarray:
    return transform(matrix_of_quaternion(link.rotation_xyzw), link.translation_m)


@given(places, places, angles, places, places, angles)
def test_both_transforms_give_the_simulated_pose(x_m, y_m, yaw_rad, odom_x_m, odom_y_m, odom_yaw_rad):
    motion = VehicleMotion(x_m, y_m, 1.5, yaw_rad, 10.0, 0.0, 0.0)
    odometry = Odometry(odom_x_m, odom_y_m, odom_yaw_rad, 10.0, 0.0, 0.0, np.eye(3), np.eye(3))
    map_from_odom, odom_from_base = frames_of(motion, odometry)
    both = matrix(map_from_odom) @ matrix(odom_from_base)
    assert np.allclose(both, map_from_base(x_m, y_m, 1.5, yaw_rad), atol=1e-9)
    assert np.allclose(matrix(odom_from_base), map_from_base(odom_x_m, odom_y_m, 0.0, odom_yaw_rad), atol=1e-9)


def test_every_carrier_has_a_chain_of_its_own():
    motion = VehicleMotion(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    odometry = Odometry(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, np.eye(3), np.eye(3))
    chains = [[(link.parent, link.child) for link in frames_of(motion, odometry, carrier)] for carrier in (EMV, AV)]
    assert chains == [[("map", "odom"), ("odom", "base_link")], [("map", "av/odom"), ("av/odom", "av/base_link")]]


def test_velocities_are_in_the_axes_of_the_vehicle():
    vx_mps, vy_mps = 5.0 * np.cos(2.0) - 1.0 * np.sin(2.0), 5.0 * np.sin(2.0) + 1.0 * np.cos(2.0)
    states = actor_states(4, actor_id=[3, 7], yaw_rad=[0.0, 2.0], vx_mps=[0.0, vx_mps], vy_mps=[0.0, vy_mps])
    motion = motion_of(states, row_of_carrier(states, 7))
    assert (motion.forward_mps, motion.left_mps) == pytest.approx((5.0, 1.0))


def test_carriers_have_noise_of_their_own():
    assert noise_seed(5, EMV) == 5
    assert noise_seed(5, AV) == noise_seed(5, AV) != noise_seed(6, AV)
    assert noise_seed(5, AV) != 5
