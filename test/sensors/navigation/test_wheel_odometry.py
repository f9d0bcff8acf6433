"""Odometry is exact without errors, drifts with them, and says by how much."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from siren_ros.numerics.geometry import wrap_angle
from siren_ros.sensors.navigation.wheel_odometry import VehicleMotion, WheelOdometry, WheelOdometrySpec
from siren_ros.world.carrier import Odometry

EXACT = WheelOdometrySpec(0.0, 0.0, 0.0, 0.0)
LARGE = WheelOdometrySpec(0.01, 0.1, 2e-3, 5e-3)
STEPS = 200


def drive(start: VehicleMotion, turn_radps: float = 0.1, steps: int = STEPS) -> list[VehicleMotion]:
    """A vehicle on a circle whose yaw rate and speed stay, at every step of 0.05 s."""
    motions = [start]
    for _ in range(steps):
        last = motions[-1]
        yaw_rad = float(wrap_angle(last.yaw_rad + turn_radps * 0.05))
        x_m = last.x_m + last.forward_mps * 0.05 * np.cos(yaw_rad)
        y_m = last.y_m + last.forward_mps * 0.05 * np.sin(yaw_rad)
        motions.append(replace(last, x_m=x_m, y_m=y_m, yaw_rad=yaw_rad, yaw_rate_radps=turn_radps))
    return motions


START = VehicleMotion(40.0, -7.0, 0.0, 2.1, 12.0, 0.0, 0.1)


def error_of(odometry: Odometry, start: VehicleMotion, now: VehicleMotion) -> np.ndarray:
    """x, y and yaw of the estimate less those of the vehicle, in the frame of its start."""
    cos, sin = np.cos(start.yaw_rad), np.sin(start.yaw_rad)
    east, north = now.x_m - start.x_m, now.y_m - start.y_m
    yaw_rad = now.yaw_rad - start.yaw_rad
    true = np.array([cos * east + sin * north, cos * north - sin * east, yaw_rad])
    error = np.array([odometry.x_m, odometry.y_m, odometry.yaw_rad]) - true
    error[2] = wrap_angle(error[2])
    return error


@given(st.floats(-3.1, 3.1), st.floats(0.0, 30.0), st.floats(-0.5, 0.5))
def test_without_errors_it_is_the_way_driven(yaw_rad: float, speed_mps: float, turn_radps: float) -> None:
    motions = drive(replace(START, yaw_rad=yaw_rad, forward_mps=speed_mps), turn_radps, 40)
    wheels = WheelOdometry(3, EXACT)
    for step, motion in enumerate(motions):
        odometry = wheels.measure(step, motion)
    assert np.allclose(error_of(odometry, motions[0], motions[-1]), 0.0, atol=1e-9)
    assert (odometry.forward_mps, odometry.left_mps) == (speed_mps, 0.0)
    assert odometry.yaw_rate_radps == motions[-1].yaw_rate_radps


def test_it_starts_at_its_own_origin() -> None:
    odometry = WheelOdometry(0).measure(0, START)
    assert (odometry.x_m, odometry.y_m, odometry.yaw_rad) == (0.0, 0.0, 0.0)
    assert np.all(np.linalg.eigvalsh(odometry.pose_covariance) > 0.0)


def test_a_missing_step_is_bridged() -> None:
    motions = drive(START)
    wheels = WheelOdometry(3, EXACT)
    for step in (0, 1, 4, 9):
        odometry = wheels.measure(step, motions[step])
    assert np.allclose(error_of(odometry, motions[0], motions[9]), 0.0, atol=1e-9)


def test_the_gyroscopes_bias_turns_for_as_long_as_nobody_asked() -> None:
    """0.15 s: three steps."""
    wheels = WheelOdometry(5, WheelOdometrySpec(0.0, 0.0, 0.01, 0.0))
    wheels.measure(2, START)
    odometry = wheels.measure(5, START)
    bias_radps = odometry.yaw_rate_radps - START.yaw_rate_radps
    assert abs(bias_radps) > 1e-3
    assert odometry.yaw_rad == pytest.approx(0.15 * bias_radps)
    assert odometry.pose_covariance[2, 2] == pytest.approx((0.15 * 0.01) ** 2)


def test_errors_are_as_large_as_the_covariance_says() -> None:
    """The mean of eᵀ P⁻¹ e is the number of dimensions, 3; its deviation over 150 seeds is √(6 / 150) = 0.2."""
    motions, squares, twists = drive(START, steps=100), [], []
    for seed in range(150):
        wheels = WheelOdometry(seed, LARGE)
        for step, motion in enumerate(motions):
            odometry = wheels.measure(step, motion)
        error = error_of(odometry, motions[0], motions[-1])
        squares.append(error @ np.linalg.solve(odometry.pose_covariance, error))
        off = np.array([odometry.forward_mps - 12.0, odometry.left_mps, odometry.yaw_rate_radps - 0.1])
        twists.append(off @ np.linalg.solve(odometry.twist_covariance, off))
    assert np.mean(squares) == pytest.approx(3.0, abs=0.6)
    assert np.mean(twists) == pytest.approx(3.0, abs=0.6)
    assert np.array_equal(odometry.pose_covariance, odometry.pose_covariance.T)


def test_a_calibrated_car_drifts_by_about_half_a_percent() -> None:
    motions = drive(replace(START, yaw_rate_radps=0.0), 0.0)
    errors = []
    for seed in range(60):
        wheels = WheelOdometry(seed)
        for step, motion in enumerate(motions):
            odometry = wheels.measure(step, motion)
        errors.append(error_of(odometry, motions[0], motions[-1]))
    driven_m = 12.0 * 0.05 * STEPS
    assert np.std(errors, axis=0)[0] == pytest.approx(0.005 * driven_m, rel=0.3)
    assert np.sqrt(odometry.pose_covariance[0, 0]) == pytest.approx(0.005 * driven_m, rel=0.1)


def test_it_depends_on_seed_and_motion_alone() -> None:
    motions = drive(START, steps=20)
    poses = []
    for seed in (5, 5, 6):
        wheels = WheelOdometry(seed)
        for step, motion in enumerate(motions):
            odometry = wheels.measure(step, motion)
        poses.append((odometry.x_m, odometry.y_m, odometry.yaw_rad))
    assert poses[0] == poses[1] != poses[2]
