"""A bias is the same however a step is reached, and it is the sum of its increments."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from siren_ros.base.numerics.geometry import wrap_angle
from siren_ros.base.numerics.units import STEP_S
from siren_ros.errors import InputError
from siren_ros.sensing.navigation import (
    STANDARD_GRAVITY_MPS2,
    BiasWalk,
    GeoReference,
    Gnss,
    GnssSpec,
    Imu,
    ImuSpec,
    PlanarMotion,
    VehicleMotion,
    WheelOdometry,
    WheelOdometrySpec,
    specific_force,
)
from siren_ros.sensing.specification import Mount, map_from_base, sensor_generator
from siren_ros.simulation.roads.road_network import RoadNetwork

PER_SQRT_S = np.array([0.1, 0.0, 0.02])


@pytest.mark.parametrize("asked", [[1, 2, 3, 4, 5], [5, 2, 5, 0, 3], [3, 3, 1, 4, 2], [50, 10, 50]])
def test_steps_can_be_asked_for_in_any_order(asked):
    walk = BiasWalk(4, "gyro", PER_SQRT_S)
    for step in asked:
        assert walk.at(step) == pytest.approx(BiasWalk(4, "gyro", PER_SQRT_S).at(step), abs=0.0)


def test_a_walk_begins_at_zero_adds_up_its_increments_and_lends_no_array():
    walk = BiasWalk(4, "gyro", PER_SQRT_S)
    assert walk.at(0).tolist() == [0.0, 0.0, 0.0]
    walk.at(2)[:] = 7.0
    assert np.abs(walk.at(2)).max() < 1.0
    assert BiasWalk(4, "gyro", np.zeros(2)).at(9).tolist() == [0.0, 0.0]
    draws = [sensor_generator(4, "gyro bias", step).standard_normal(3) for step in range(1, 4)]
    expected = np.sum(draws, axis=0) * PER_SQRT_S * np.sqrt(STEP_S)
    assert BiasWalk(4, "gyro", PER_SQRT_S).at(3) == pytest.approx(expected)


NETWORK = RoadNetwork((), (), (), {}, (0.0, 0.0), "!")
EXACT_GNSS = GnssSpec("gnss", Mount(0.0, 0.0, 1.93), 10.0, 0.0, 0.0, 0.0)
M_PER_DEG_LAT = 111_207.0  # of the meridian at 49 degrees north (WGS 84)


def test_the_documented_place_and_a_hundred_metres_north_and_east():
    fix = Gnss(EXACT_GNSS, GeoReference.of(NETWORK), 0).measure(0, map_from_base(0.0, 0.0, 0.5, 1.0))
    assert (fix.latitude_deg, fix.longitude_deg) == pytest.approx((49.0, 8.4), abs=1e-8)
    assert fix.altitude_m == pytest.approx(2.43)
    receiver = Gnss(EXACT_GNSS, GeoReference.of(NETWORK), 0)
    north = receiver.measure(0, map_from_base(0.0, 100.0, 0.0, 0.0))
    east = receiver.measure(0, map_from_base(100.0, 0.0, 0.0, 0.0))
    assert (north.latitude_deg - 49.0) * M_PER_DEG_LAT == pytest.approx(100.0, abs=0.05)
    per_degree = np.pi / 180.0 * 6_378_137.0 / np.sqrt(1.0 - 0.00669438 * np.sin(np.radians(49)) ** 2)
    assert (east.longitude_deg - 8.4) * per_degree * np.cos(np.radians(49)) == pytest.approx(100.0, abs=0.01)
    ahead = replace(EXACT_GNSS, mount=Mount(10.0, 0.0, 1.0))  # its lever arm turns with the carrier
    fix = Gnss(ahead, GeoReference.of(NETWORK), 0).measure(0, map_from_base(0.0, 0.0, 0.0, np.pi / 2))
    assert (fix.latitude_deg - 49.0) * M_PER_DEG_LAT == pytest.approx(10.0, abs=0.01)
    assert fix.longitude_deg == pytest.approx(8.4, abs=1e-9)


def test_the_maps_own_reference_is_used_with_its_offset():
    utm = replace(
        NETWORK,
        projection="+proj=utm +zone=32 +ellps=WGS84",
        origin_lat_lon_deg=(48.0, 9.0),
        projected_origin_m=(500_000.0, 0.0),
    )
    assert GeoReference.of(utm).geodetic(0.0, 0.0) == pytest.approx((0.0, 9.0), abs=1e-9)
    shifted = replace(utm, projected_origin_m=(500_300.0, 5_000_400.0))
    moved = replace(utm, projected_origin_m=(500_000.0, 5_000_000.0))
    assert GeoReference.of(shifted).geodetic(-100.0, 50.0) == GeoReference.of(moved).geodetic(200.0, 450.0)
    with pytest.raises(InputError, match="projection"):
        GeoReference("+proj=merc", (0.0, 0.0)).geodetic(0.0, 0.0)


def test_the_variance_grows_as_the_bias_walks():
    """A random walk of 0.3 m/√s has a variance of 0.09 m² for each second, on every axis."""
    walking = replace(
        EXACT_GNSS, horizontal_noise_stddev_m=0.2, vertical_noise_stddev_m=0.4, bias_walk_m_per_sqrt_s=0.3
    )
    reference, errors = GeoReference.of(NETWORK), []
    for seed in range(300):
        fix = Gnss(walking, reference, seed).measure(40, np.eye(4))
        assert fix.variance_m2 == pytest.approx([0.04 + 0.18, 0.04 + 0.18, 0.16 + 0.18])
        errors.append(((fix.latitude_deg - 49.0) * M_PER_DEG_LAT, fix.altitude_m - 1.93))
    north, up = np.array(errors).T
    assert (north.var(), up.var()) == pytest.approx((0.22, 0.34), rel=0.25)
    assert np.abs(np.mean(errors, axis=0)).max() < 0.1


QUIET = ImuSpec("imu", Mount(0.0, 0.0, 0.0), 20.0, 0.0, 0.0, 0.0, 0.0)
STILL = PlanarMotion(0, 0.0, 0.0, 0.0, 0.0)


def circling(step, radius_m, rate_radps):
    yaw = rate_radps * step * STEP_S
    speed = radius_m * rate_radps
    return PlanarMotion(step, yaw, speed * np.cos(yaw), speed * np.sin(yaw), rate_radps)


def test_gravity_is_felt_at_rest_braking_backwards_and_on_a_circle_its_own_radius():
    still = (PlanarMotion(step, 1.0, 0.0, 0.0, 0.0) for step in (0, 1))
    assert specific_force(*still, np.array([1.0, 2.0, 3.0])).tolist() == [0.0, 0.0, STANDARD_GRAVITY_MPS2]
    again = PlanarMotion(1, 1.0, 2.0, 3.0, 0.0), PlanarMotion(1, 1.0, 4.0, 5.0, 0.0)
    assert specific_force(*again, np.zeros(3)).tolist() == [0.0, 0.0, STANDARD_GRAVITY_MPS2], "of no earlier step"
    for yaw in (0.0, 0.7, -2.5):
        before = PlanarMotion(4, yaw, 10.0 * np.cos(yaw), 10.0 * np.sin(yaw), 0.0)
        now = PlanarMotion(5, yaw, 9.8 * np.cos(yaw), 9.8 * np.sin(yaw), 0.0)
        assert specific_force(before, now, np.zeros(3))[:2] == pytest.approx([-0.2 / STEP_S, 0.0], abs=1e-9)
    radius, rate = 20.0, 0.05
    force = specific_force(circling(99, radius, rate), circling(100, radius, rate), np.array([0.0, -2.0, 0.0]))
    assert force[1] == pytest.approx((radius + 2.0) * rate**2, rel=2e-3)  # to the left, where the centre is


@pytest.mark.parametrize(
    ("lever_m", "expected_mps2"),
    [((2.0, 0.0, 0.0), (-2.0 * 0.1**2, 2.0 * 0.1 / STEP_S)), ((0.0, 1.5, 0.0), (-1.5 * 0.1 / STEP_S, -1.5 * 0.1**2))],
    ids=["ahead of the origin: to the left", "left of the origin: backwards"],
)
def test_a_growing_yaw_rate_pushes_a_sensor(lever_m, expected_mps2):
    force = specific_force(STILL, PlanarMotion(1, 0.0, 0.0, 0.0, 0.1), np.array(lever_m))
    assert force[:2] == pytest.approx(expected_mps2)


def test_the_time_since_the_motion_before_counts():
    """Three steps earlier: a third of what the same difference over one step is."""
    before, now = PlanarMotion(4, 0.0, 2.0, -1.0, 0.0), PlanarMotion(7, 0.0, 2.6, -1.3, 0.09)
    force = specific_force(before, now, np.array([2.0, 0.0, 0.0]))
    assert force[0] == pytest.approx(0.6 / (3.0 * STEP_S) - 2.0 * 0.09**2)
    assert force[1] == pytest.approx((-0.3 + 2.0 * 0.09) / (3.0 * STEP_S))


def test_accelerations_are_differences_to_the_step_before():
    unit = Imu(QUIET, 0)
    speeds = [0.0, 0.1, 0.3, 0.3, 0.1]
    forces = [unit.measure(PlanarMotion(k, 0.0, v, 0.0, 0.0)).specific_force_mps2[0] for k, v in enumerate(speeds)]
    assert forces == pytest.approx([0.0, 2.0, 4.0, 0.0, -4.0])


def test_each_bias_walks_on_its_own_axis():
    gyro_alone = replace(QUIET, gyro_bias_walk_radps_per_sqrt_s=0.01)
    unit = Imu(gyro_alone, 0)
    samples = [unit.measure(replace(STILL, step=step)) for step in range(100)]
    assert samples[-1].specific_force_mps2.tolist() == [0.0, 0.0, STANDARD_GRAVITY_MPS2]
    assert np.all(np.abs(samples[-1].angular_rate_radps) > 1e-4)
    late = replace(STILL, step=80)
    ends = np.array([Imu(gyro_alone, seed).measure(late).angular_rate_radps for seed in range(60)])
    assert ends.std(axis=0) == pytest.approx([0.01 * np.sqrt(80 * STEP_S)] * 3, rel=0.3)


def test_a_tilted_sensor_turns_what_it_measures_into_its_axes():
    on_its_side = Imu(replace(QUIET, mount=Mount(0.0, 0.0, 1.93, roll_rad=np.pi / 2)), 0)
    sample = on_its_side.measure(PlanarMotion(0, 0.0, 3.0, 0.0, 0.4))
    assert sample.specific_force_mps2 == pytest.approx([0.0, STANDARD_GRAVITY_MPS2, 0.0], abs=1e-9)
    assert sample.angular_rate_radps == pytest.approx([0.0, 0.4, 0.0], abs=1e-9)


def test_the_noise_has_the_asked_spread_and_follows_the_seed():
    spec = replace(QUIET, accel_noise_stddev_mps2=0.1, gyro_noise_stddev_radps=0.01)
    steps = [replace(STILL, step=step) for step in range(400)]
    first, second, other = (Imu(spec, seed) for seed in (1, 1, 2))
    samples = np.array([first.measure(now).specific_force_mps2 for now in steps])
    assert np.array_equal(samples, [second.measure(now).specific_force_mps2 for now in steps])
    assert not np.array_equal(samples[0], other.measure(steps[0]).specific_force_mps2)
    assert samples.std(axis=0) == pytest.approx([0.1] * 3, rel=0.15)
    assert samples.mean(axis=0) == pytest.approx([0.0, 0.0, STANDARD_GRAVITY_MPS2], abs=0.03)


EXACT_WHEELS = WheelOdometrySpec(0.0, 0.0, 0.0, 0.0)
LARGE = WheelOdometrySpec(0.01, 0.1, 2e-3, 5e-3)
STEPS = 200


def drive(start, turn_radps=0.1, steps=STEPS):
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


def at_the_end(wheels, motions):
    return [wheels.measure(step, motion) for step, motion in enumerate(motions)][-1]


def error_of(odometry, start, now):
    """x, y and yaw of the estimate less those of the vehicle, in the frame of its start."""
    cos, sin = np.cos(start.yaw_rad), np.sin(start.yaw_rad)
    east, north = now.x_m - start.x_m, now.y_m - start.y_m
    x_m, y_m = odometry.x_m - (cos * east + sin * north), odometry.y_m - (cos * north - sin * east)
    return np.array([x_m, y_m, float(wrap_angle(odometry.yaw_rad - (now.yaw_rad - start.yaw_rad)))])


@given(st.floats(-3.1, 3.1), st.floats(0.0, 30.0), st.floats(-0.5, 0.5))
def test_without_errors_it_is_the_way_driven(yaw_rad, speed_mps, turn_radps):
    motions = drive(replace(START, yaw_rad=yaw_rad, forward_mps=speed_mps), turn_radps, 40)
    odometry = at_the_end(WheelOdometry(3, EXACT_WHEELS), motions)
    assert np.allclose(error_of(odometry, motions[0], motions[-1]), 0.0, atol=1e-9)
    assert (odometry.forward_mps, odometry.left_mps) == (speed_mps, 0.0)
    assert odometry.yaw_rate_radps == motions[-1].yaw_rate_radps


def test_a_missing_step_is_bridged():
    motions = drive(START)
    wheels = WheelOdometry(3, EXACT_WHEELS)
    for step in (0, 1, 4, 9):
        odometry = wheels.measure(step, motions[step])
    assert np.allclose(error_of(odometry, motions[0], motions[9]), 0.0, atol=1e-9)


def test_what_slides_slides_by_the_scale_too():
    """Both speeds are a tenth or so off, and so are the variances' ways of being off together."""
    wheels = WheelOdometry(5, WheelOdometrySpec(0.1, 0.0, 0.0, 0.0))
    first, second = (wheels.measure(at, replace(START, left_mps=-3.0, x_m=40.0 + at)) for at in (0, 1))
    scale = first.forward_mps / 12.0
    assert abs(scale - 1.0) > 0.01
    assert first.left_mps == pytest.approx(-3.0 * scale)
    speeds = 0.1 * np.array([first.forward_mps, first.left_mps])
    assert first.twist_covariance[:2, :2] == pytest.approx(np.outer(speeds, speeds))
    assert (second.x_m, second.y_m) == pytest.approx((scale * np.cos(2.1), -scale * np.sin(2.1)))
    noisy = WheelOdometry(5, WheelOdometrySpec(0.0, 0.1, 0.0, 0.0)).measure(0, replace(START, left_mps=-3.0))
    assert abs(noisy.forward_mps - 12.0 - (noisy.left_mps + 3.0)) > 0.01, "each noise is one of its own"


def test_the_gyroscopes_bias_turns_for_as_long_as_nobody_asked():
    """0.15 s: three steps."""
    wheels = WheelOdometry(5, WheelOdometrySpec(0.0, 0.0, 0.01, 0.0))
    wheels.measure(2, START)
    odometry = wheels.measure(5, START)
    bias_radps = odometry.yaw_rate_radps - START.yaw_rate_radps
    assert abs(bias_radps) > 1e-3
    assert odometry.yaw_rad == pytest.approx(0.15 * bias_radps)
    assert odometry.pose_covariance[2, 2] == pytest.approx((0.15 * 0.01) ** 2)


def test_errors_are_as_large_as_the_covariance_says():
    """The mean of eᵀ P⁻¹ e is the number of dimensions, 3; its deviation over 150 seeds is √(6 / 150) = 0.2."""
    motions, squares, twists = drive(START, steps=100), [], []
    for seed in range(150):
        odometry = at_the_end(WheelOdometry(seed, LARGE), motions)
        error = error_of(odometry, motions[0], motions[-1])
        squares.append(error @ np.linalg.solve(odometry.pose_covariance, error))
        off = np.array([odometry.forward_mps - 12.0, odometry.left_mps, odometry.yaw_rate_radps - 0.1])
        twists.append(off @ np.linalg.solve(odometry.twist_covariance, off))
    assert (np.mean(squares), np.mean(twists)) == pytest.approx((3.0, 3.0), abs=0.6)
    assert np.array_equal(odometry.pose_covariance, odometry.pose_covariance.T)


def test_it_depends_on_seed_and_motion_alone():
    motions = drive(START, steps=20)
    ends = [at_the_end(WheelOdometry(seed), motions) for seed in (5, 5, 6)]
    poses = [(odometry.x_m, odometry.y_m, odometry.yaw_rad) for odometry in ends]
    assert poses[0] == poses[1] != poses[2]
    assert np.sqrt(ends[0].pose_covariance[0, 0]) == pytest.approx(0.005 * 12.0, rel=0.1), "half a percent of the way"
    first = WheelOdometry(0).measure(0, START)
    assert (first.x_m, first.y_m, first.yaw_rad) == (0.0, 0.0, 0.0)
    assert np.all(np.linalg.eigvalsh(first.pose_covariance) > 0.0)
