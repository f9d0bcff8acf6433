import numpy as np
import pytest

from siren_ros.numerics.units import STEP_S
from siren_ros.sensors.navigation.bias_walk import BiasWalk
from siren_ros.sensors.navigation.imu import STANDARD_GRAVITY_MPS2, Imu, PlanarMotion, specific_force
from siren_ros.sensors.suite.mount import Mount
from siren_ros.sensors.suite.suite import ImuSpec

QUIET = {
    "accel_noise_stddev_mps2": 0.0,
    "gyro_noise_stddev_radps": 0.0,
    "accel_bias_walk_mps2_per_sqrt_s": 0.0,
    "gyro_bias_walk_radps_per_sqrt_s": 0.0,
}


def circling(step: int, radius_m: float, rate_radps: float) -> PlanarMotion:
    yaw = rate_radps * step * STEP_S
    speed = radius_m * rate_radps
    return PlanarMotion(step, yaw, speed * np.cos(yaw), speed * np.sin(yaw), rate_radps)


def test_at_rest_it_feels_gravity_alone() -> None:
    still = PlanarMotion(0, 1.0, 0.0, 0.0, 0.0)
    later = PlanarMotion(1, 1.0, 0.0, 0.0, 0.0)
    assert specific_force(still, later, np.array([1.0, 2.0, 3.0])).tolist() == [0.0, 0.0, STANDARD_GRAVITY_MPS2]


def test_braking_is_felt_backwards_whatever_the_heading() -> None:
    for yaw in (0.0, 0.7, -2.5):
        before = PlanarMotion(4, yaw, 10.0 * np.cos(yaw), 10.0 * np.sin(yaw), 0.0)
        now = PlanarMotion(5, yaw, 9.8 * np.cos(yaw), 9.8 * np.sin(yaw), 0.0)
        force = specific_force(before, now, np.zeros(3))
        assert force[:2] == pytest.approx([-0.2 / STEP_S, 0.0], abs=1e-9)


def test_on_a_circle_it_feels_the_centripetal_acceleration_of_its_own_radius() -> None:
    radius, rate = 20.0, 0.05
    force = specific_force(circling(99, radius, rate), circling(100, radius, rate), np.array([0.0, -2.0, 0.0]))
    assert force[1] == pytest.approx((radius + 2.0) * rate**2, rel=2e-3)  # to the left, where the centre is


def test_a_growing_yaw_rate_pushes_a_sensor_ahead_of_the_origin_to_the_left() -> None:
    before, now = PlanarMotion(0, 0.0, 0.0, 0.0, 0.0), PlanarMotion(1, 0.0, 0.0, 0.0, 0.1)
    force = specific_force(before, now, np.array([2.0, 0.0, 0.0]))
    assert force[1] == pytest.approx(2.0 * 0.1 / STEP_S)
    assert force[0] == pytest.approx(-2.0 * 0.1**2)


def test_the_time_since_the_motion_before_counts() -> None:
    """Three steps earlier: a third of what the same difference over one step is."""
    before, now = PlanarMotion(4, 0.0, 2.0, -1.0, 0.0), PlanarMotion(7, 0.0, 2.6, -1.3, 0.09)
    force = specific_force(before, now, np.array([2.0, 0.0, 0.0]))
    assert force[0] == pytest.approx(0.6 / (3.0 * STEP_S) - 2.0 * 0.09**2)
    assert force[1] == pytest.approx((-0.3 + 2.0 * 0.09) / (3.0 * STEP_S))


def test_a_growing_yaw_rate_pushes_a_sensor_left_of_the_origin_backwards() -> None:
    before, now = PlanarMotion(0, 0.0, 0.0, 0.0, 0.0), PlanarMotion(1, 0.0, 0.0, 0.0, 0.1)
    force = specific_force(before, now, np.array([0.0, 1.5, 0.0]))
    assert force[0] == pytest.approx(-1.5 * 0.1 / STEP_S)
    assert force[1] == pytest.approx(-1.5 * 0.1**2)


def test_accelerations_are_differences_to_the_step_before() -> None:
    unit = Imu(ImuSpec("imu", Mount(0.0, 0.0, 0.0), **QUIET), 0)
    speeds = [0.0, 0.1, 0.3, 0.3, 0.1]
    forces = [unit.measure(PlanarMotion(k, 0.0, v, 0.0, 0.0)).specific_force_mps2[0] for k, v in enumerate(speeds)]
    assert forces == pytest.approx([0.0, 2.0, 4.0, 0.0, -4.0])


def test_each_bias_walks_on_its_own_axis() -> None:
    gyro_alone = {**QUIET, "gyro_bias_walk_radps_per_sqrt_s": 0.01}
    unit = Imu(ImuSpec("imu", Mount(0.0, 0.0, 0.0), **gyro_alone), 0)
    samples = [unit.measure(PlanarMotion(step, 0.0, 0.0, 0.0, 0.0)) for step in range(100)]
    assert samples[-1].specific_force_mps2.tolist() == [0.0, 0.0, STANDARD_GRAVITY_MPS2]
    assert np.all(np.abs(samples[-1].angular_rate_radps) > 1e-4)
    ends = np.array(
        [
            Imu(ImuSpec("imu", Mount(0.0, 0.0, 0.0), **gyro_alone), seed)
            .measure(PlanarMotion(80, 0, 0, 0, 0))
            .angular_rate_radps
            for seed in range(60)
        ]
    )
    assert ends.std(axis=0) == pytest.approx([0.01 * np.sqrt(80 * STEP_S)] * 3, rel=0.3)


def test_a_tilted_sensor_turns_what_it_measures_into_its_axes() -> None:
    on_its_side = Imu(ImuSpec("imu", Mount(0.0, 0.0, 1.93, roll_rad=np.pi / 2), **QUIET), 0)
    sample = on_its_side.measure(PlanarMotion(0, 0.0, 3.0, 0.0, 0.4))
    assert sample.specific_force_mps2 == pytest.approx([0.0, STANDARD_GRAVITY_MPS2, 0.0], abs=1e-9)
    assert sample.angular_rate_radps == pytest.approx([0.0, 0.4, 0.0], abs=1e-9)


def test_the_noise_has_the_asked_spread_and_follows_the_seed() -> None:
    spec = ImuSpec("imu", Mount(0, 0, 0), **{**QUIET, "accel_noise_stddev_mps2": 0.1, "gyro_noise_stddev_radps": 0.01})
    steps = [PlanarMotion(step, 0.0, 0.0, 0.0, 0.0) for step in range(400)]
    first, second, other = (Imu(spec, seed) for seed in (1, 1, 2))
    samples = np.array([first.measure(now).specific_force_mps2 for now in steps])
    assert np.array_equal(samples, [second.measure(now).specific_force_mps2 for now in steps])
    assert not np.array_equal(samples[0], other.measure(steps[0]).specific_force_mps2)
    assert samples.std(axis=0) == pytest.approx([0.1] * 3, rel=0.15)
    assert samples.mean(axis=0) == pytest.approx([0.0, 0.0, STANDARD_GRAVITY_MPS2], abs=0.03)


def test_a_bias_walks_with_the_root_of_time_and_does_not_depend_on_who_asks_when() -> None:
    ends = np.array([BiasWalk(seed, "imu", np.array([0.2])).at(400)[0] for seed in range(150)])
    assert ends.std() == pytest.approx(0.2 * np.sqrt(400 * STEP_S), rel=0.2)
    walk = BiasWalk(3, "imu", np.array([0.2, 0.0]))
    late = walk.at(50)
    assert walk.at(10).tolist() == BiasWalk(3, "imu", np.array([0.2, 0.0])).at(10).tolist()
    assert walk.at(50).tolist() == late.tolist()
    assert late[1] == 0.0
