"""Sensors of position and motion: the satellite receiver, the inertial measurement unit, and wheel odometry.

Biases wander: a random walk per axis, which is a function of seed, sensor and step alone. Dead reckoning from wheel
increments and a gyroscope gives a pose that is smooth and drifts (REP 105's ``odom``).
"""

from dataclasses import dataclass
from typing import Final

import numpy as np

from siren_ros.base.numerics.arrays import Floats, Matrix
from siren_ros.base.numerics.compiled import wrapped_rad
from siren_ros.base.numerics.units import STEP_S
from siren_ros.errors import InputError
from siren_ros.sensing.specification import SensorSpec, number, rate, sensor_generator
from siren_ros.simulation.roads.road_network import RoadNetwork, geodetic_from_projected
from siren_ros.simulation.world.actors import ActorStates, rows_of_ids
from siren_ros.simulation.world.carrier import GnssFix, ImuSample, Odometry


@dataclass(frozen=True)
class GnssSpec(SensorSpec):
    """A GNSS receiver: white noise and a bias that walks, per axis.

    Defaults: an RTK receiver, 0.01 m circular error probable and 0.01 m vertical R50 (u-blox, ZED-F9P data sheet,
    position accuracy RTK); for normal errors CEP is 1.1774 and R50 0.6745 standard deviations. The walk reaches
    2.5 cm within 100 s, of the order of RTK's 1 ppm over the baselines of a town's network.
    """

    rate_hz: float = rate(10.0)
    horizontal_noise_stddev_m: float = number(0.0, 50.0, 0.0085)
    vertical_noise_stddev_m: float = number(0.0, 50.0, 0.0148)
    bias_walk_m_per_sqrt_s: float = number(0.0, 10.0, 0.0025)


@dataclass(frozen=True)
class ImuSpec(SensorSpec):
    """An IMU: white noise and a bias that walks, per axis.

    Defaults: an industrial MEMS unit, noise densities 0.14 mg/√Hz and 0.0035 °/s/√Hz (VectorNav, VN-100 data sheet)
    over the 10 Hz of bandwidth that 20 Hz leave; the biases walk by its in-run stabilities, 0.04 mg and
    10 °/h, within 100 s.
    """

    rate_hz: float = rate(20.0)
    accel_noise_stddev_mps2: float = number(0.0, 10.0, 4.3e-3)
    gyro_noise_stddev_radps: float = number(0.0, 10.0, 1.9e-4)
    accel_bias_walk_mps2_per_sqrt_s: float = number(0.0, 1.0, 3.9e-5)
    gyro_bias_walk_radps_per_sqrt_s: float = number(0.0, 1.0, 4.8e-6)


class BiasWalk:
    """A bias that wanders: the sum of one normal increment per step from step 1 on; zero at step 0.

    Each increment has its own random stream.
    """

    def __init__(self, seed: int, sensor: str, per_sqrt_s: Floats) -> None:
        """Start the walk.

        ``per_sqrt_s``, ``(K,)``, is the standard deviation of each axis after 1 s; it grows with √t.
        """
        self._seed = seed
        self._stream = f"{sensor} bias"
        self._stddev = np.asarray(per_sqrt_s, dtype=np.float64) * np.sqrt(STEP_S)
        self._step = 0
        self._bias = np.zeros(len(self._stddev))

    def at(self, step: int) -> Floats:
        """The bias at a step, shape ``(K,)``; steps may be requested in any order."""
        if step < self._step:
            self._step, self._bias = 0, np.zeros(len(self._stddev))
        if np.any(self._stddev):
            for passed in range(self._step + 1, step + 1):
                draw = sensor_generator(self._seed, self._stream, passed).standard_normal(len(self._stddev))
                self._bias = self._bias + draw * self._stddev
        self._step = step
        return self._bias.copy()


DEFAULT_PROJECTION: Final = "+proj=tmerc +lat_0=49 +lon_0=8.4 +k=1 +x_0=0 +y_0=0 +datum=WGS84 +units=m"
"""Projection of maps without a geo-reference, such as the built-in town: 49° N, 8.4° E, in the Rhine valley."""


@dataclass(frozen=True)
class GeoReference:
    """Converts the ``map`` frame to the WGS 84 ellipsoid, on which z is 0."""

    projection: str
    origin_m: tuple[float, float]
    """Projected coordinates of the map frame's origin."""

    @classmethod
    def of(cls, network: RoadNetwork) -> "GeoReference":
        """The reference of the map, or the default if the map has none in transverse Mercator or UTM."""
        if network.origin_lat_lon_deg is None:
            return cls(DEFAULT_PROJECTION, (0.0, 0.0))
        return cls(network.projection, network.projected_origin_m)

    def geodetic(self, x_m: float, y_m: float) -> tuple[float, float]:
        """Latitude and longitude in degrees of a place in ``map``; InputError for an unknown projection."""
        geodetic = geodetic_from_projected(self.projection, x_m + self.origin_m[0], y_m + self.origin_m[1])
        if geodetic is None:
            raise InputError("projection", self.projection, "a transverse Mercator or UTM projection")
        return geodetic


class Gnss:
    """Simulates one satellite receiver on one carrier."""

    def __init__(self, spec: GnssSpec, reference: GeoReference, seed: int) -> None:
        """Prepare the noise; ``seed`` is that of the carrier's noise."""
        self.spec = spec
        self._reference = reference
        self._seed = seed
        self._bias = BiasWalk(seed, spec.name, np.full(3, spec.bias_walk_m_per_sqrt_s))

    def measure(self, step: int, map_from_base: Matrix) -> GnssFix:
        """The position at a step, for a pose of the carrier, shape ``(4, 4)``."""
        spec, mount = self.spec, self.spec.mount
        antenna = map_from_base @ np.array([mount.x_m, mount.y_m, mount.z_m, 1.0])
        flat, up = spec.horizontal_noise_stddev_m, spec.vertical_noise_stddev_m
        noise = sensor_generator(self._seed, spec.name, step).standard_normal(3) * np.array([flat, flat, up])
        east, north, height = antenna[:3] + self._bias.at(step) + noise
        latitude, longitude = self._reference.geodetic(float(east), float(north))
        walked = spec.bias_walk_m_per_sqrt_s**2 * (step * STEP_S)
        variance = np.array([flat**2, flat**2, up**2]) + walked
        return GnssFix(step, spec.name, latitude, longitude, float(height), variance)


STANDARD_GRAVITY_MPS2: Final = 9.80665
"""Standard gravity (CGPM 1901)."""


@dataclass(frozen=True)
class PlanarMotion:
    """Velocity of a carrier's ``base_link`` in the ``map`` frame, and its heading, at one step."""

    step: int
    yaw_rad: float
    vx_mps: float
    vy_mps: float
    yaw_rate_radps: float


def specific_force(before: PlanarMotion | None, now: PlanarMotion, lever_m: Floats) -> Floats:
    """Specific force at the place ``lever_m``, ``(3,)``, of a body that moves in the plane; in ``base_link``, ``(3,)``.

    f = Rᵀ (a + g e_z) + α × r + ω × (ω × r), with a and α as differences over the time since ``before``, an earlier
    step; zero where there is none (Groves, Principles of GNSS, Inertial and Multisensor Navigation Systems, 2nd ed.,
    section 4.1 and eq. 2.161 for the lever arm).
    """
    ax = ay = spin = 0.0
    if before is not None and before.step < now.step:
        elapsed_s = (now.step - before.step) * STEP_S
        ax, ay = (now.vx_mps - before.vx_mps) / elapsed_s, (now.vy_mps - before.vy_mps) / elapsed_s
        spin = (now.yaw_rate_radps - before.yaw_rate_radps) / elapsed_s
    cos, sin = np.cos(now.yaw_rad), np.sin(now.yaw_rad)
    x, y, square = lever_m[0], lever_m[1], now.yaw_rate_radps**2
    along, across = cos * ax + sin * ay - spin * y - square * x, cos * ay - sin * ax + spin * x - square * y
    return np.array([along, across, STANDARD_GRAVITY_MPS2])


class Imu:
    """Simulates one inertial measurement unit on one carrier. It keeps the motion of the last step."""

    def __init__(self, spec: ImuSpec, seed: int) -> None:
        """Prepare the noise; ``seed`` is that of the carrier's noise."""
        self.spec = spec
        self._seed = seed
        walk = [spec.accel_bias_walk_mps2_per_sqrt_s] * 3 + [spec.gyro_bias_walk_radps_per_sqrt_s] * 3
        self._bias = BiasWalk(seed, spec.name, np.array(walk))
        self._before: PlanarMotion | None = None

    def measure(self, now: PlanarMotion) -> ImuSample:
        """The measurement at a step; call it at every step."""
        spec, mount = self.spec, self.spec.mount
        force = specific_force(self._before, now, np.array([mount.x_m, mount.y_m, mount.z_m]))
        self._before = now
        sensor_from_base = mount.base_from_sensor[:3, :3].T
        bias = self._bias.at(now.step)
        noise = sensor_generator(self._seed, spec.name, now.step).standard_normal(6)
        rate = sensor_from_base @ np.array([0.0, 0.0, now.yaw_rate_radps])
        measured_force = sensor_from_base @ force + bias[:3] + noise[:3] * spec.accel_noise_stddev_mps2
        measured_rate = rate + bias[3:] + noise[3:] * spec.gyro_noise_stddev_radps
        variances = (spec.accel_noise_stddev_mps2**2, spec.gyro_noise_stddev_radps**2)
        return ImuSample(now.step, spec.name, measured_force, measured_rate, *variances)


@dataclass(frozen=True)
class WheelOdometrySpec:
    """Errors of wheel odometry: two constants drawn once for an episode, and white noise.

    Tyre radii are known to about 0.5 % (load, pressure and wear change them); wheel speed sensors resolve a few cm/s.
    The gyroscope is an industrial MEMS unit with the errors of ``ImuSpec``: an in-run bias of 10 °/h and a noise
    density of 0.0035 °/s/√Hz over 10 Hz (VectorNav, VN-100 data sheet).
    """

    scale_stddev: float = 0.005
    """Standard deviation of the scale error of all distances, constant in an episode."""
    speed_noise_stddev_mps: float = 0.03
    gyro_bias_stddev_radps: float = 4.85e-5
    """Standard deviation of the gyroscope's bias, constant in an episode."""
    gyro_noise_stddev_radps: float = 1.9e-4


@dataclass(frozen=True)
class VehicleMotion:
    """The simulated pose of ``base_link`` in ``map`` and its velocity in its own axes."""

    x_m: float
    y_m: float
    z_m: float
    yaw_rad: float
    forward_mps: float
    left_mps: float
    yaw_rate_radps: float


class WheelOdometry:
    """Simulates the odometry of one vehicle. The ``odom`` frame begins at the vehicle's pose at the first step."""

    def __init__(self, seed: int, spec: WheelOdometrySpec | None = None) -> None:
        """Draw the constant errors; ``seed`` is that of the carrier's noise."""
        self._seed = seed
        self._spec = spec = spec or WheelOdometrySpec()
        draws = sensor_generator(seed, "odometry constants", 0).standard_normal(2)
        self._scale = 1.0 + float(draws[0]) * spec.scale_stddev
        self._gyro_bias_radps = float(draws[1]) * spec.gyro_bias_stddev_radps
        self._before: tuple[int, VehicleMotion] | None = None
        self._pose = (0.0, 0.0, 0.0)
        self._noise_of = 0.0, np.zeros((5, 5))
        """The last covariance of ``_noise`` and its time."""
        constants = np.diag([0.0, 0.0, 0.0, spec.scale_stddev**2, spec.gyro_bias_stddev_radps**2])
        self._covariance = constants + self._noise(STEP_S)
        """Of the errors of x, y, yaw, scale and gyro bias. At first the noise of one step: invertible."""

    def measure(self, step: int, now: VehicleMotion) -> Odometry:
        """The estimate at a step; call it at every step."""
        spec = self._spec
        draws = sensor_generator(self._seed, "odometry", step).standard_normal(3)
        slip_mps = float(draws[0]) * spec.speed_noise_stddev_mps, float(draws[1]) * spec.speed_noise_stddev_mps
        spin_radps = self._gyro_bias_radps + float(draws[2]) * spec.gyro_noise_stddev_radps
        if self._before is not None:
            self._integrate(self._before[1], now, (step - self._before[0]) * STEP_S, slip_mps, spin_radps)
        self._before = step, now
        forward_mps, left_mps = self._scale * now.forward_mps + slip_mps[0], self._scale * now.left_mps + slip_mps[1]
        scale, noise = spec.scale_stddev**2, spec.speed_noise_stddev_mps**2
        spin = spec.gyro_bias_stddev_radps**2 + spec.gyro_noise_stddev_radps**2
        both = forward_mps * left_mps * scale + 0.0  # adding 0.0 turns -0.0 into 0.0
        twist_covariance = np.array(
            [
                [forward_mps * forward_mps * scale + noise, both, 0.0],
                [both, left_mps * left_mps * scale + noise, 0.0],
                [0.0, 0.0, spin],
            ]
        )
        twist = (forward_mps, left_mps, now.yaw_rate_radps + spin_radps)
        return Odometry(*self._pose, *twist, self._covariance[:3, :3].copy(), twist_covariance)

    def _integrate(
        self,
        before: VehicleMotion,
        now: VehicleMotion,
        elapsed_s: float,
        slip_mps: tuple[float, float],
        spin_radps: float,
    ) -> None:
        """Add the motion since the last step, in the axes of that step, and propagate the covariance.

        P ← F P Fᵀ + Q with the Jacobian F of the motion model (Siegwart and Nourbakhsh, Introduction to Autonomous
        Mobile Robots, section 5.2.4), here with scale and gyro bias as further, constant states.
        """
        cos, sin = float(np.cos(before.yaw_rad)), float(np.sin(before.yaw_rad))
        east, north = now.x_m - before.x_m, now.y_m - before.y_m
        ahead = self._scale * (cos * east + sin * north) + slip_mps[0] * elapsed_s
        left = self._scale * (cos * north - sin * east) + slip_mps[1] * elapsed_s
        turn = wrapped_rad(now.yaw_rad - before.yaw_rad) + spin_radps * elapsed_s
        x_m, y_m, yaw_rad = self._pose
        cos, sin = float(np.cos(yaw_rad)), float(np.sin(yaw_rad))
        dx, dy = cos * ahead - sin * left, sin * ahead + cos * left
        self._pose = x_m + dx, y_m + dy, wrapped_rad(yaw_rad + turn)
        jacobian = np.eye(5)
        jacobian[0, 2:4] = -dy, dx
        jacobian[1, 2:4] = dx, dy
        jacobian[2, 4] = elapsed_s
        propagated = jacobian @ self._covariance @ jacobian.T + self._noise(elapsed_s)
        self._covariance = (propagated + propagated.T) / 2.0

    def _noise(self, elapsed_s: float) -> Floats:
        """Covariance that the white noise of one step adds, shape ``(5, 5)``."""
        if elapsed_s == self._noise_of[0]:  # true at every step but the first
            return self._noise_of[1]
        slip, spin = self._spec.speed_noise_stddev_mps * elapsed_s, self._spec.gyro_noise_stddev_radps * elapsed_s
        self._noise_of = elapsed_s, np.diag([slip**2, slip**2, spin**2, 0.0, 0.0])
        return self._noise_of[1]


class Odometers:
    """Distance that every actor has driven, so that drawn wheels turn."""

    def __init__(self) -> None:
        self._step: int | None = None
        self._ids = np.empty(0, np.uint32)
        self._rolled_m = np.empty(0, np.float64)

    def advance(self, states: ActorStates) -> Floats:
        """Distance that the wheels of each row of the states have rolled since the actor was first seen."""
        rows = rows_of_ids(self._ids, states.actor_id)
        rolled = np.where(rows >= 0, self._rolled_m[rows], 0.0) if len(self._ids) else np.zeros(len(states))
        elapsed_s = 0.0 if self._step is None else (states.step - self._step) * STEP_S
        forward = states.vx_mps * np.cos(states.yaw_rad) + states.vy_mps * np.sin(states.yaw_rad)
        rolled = rolled + forward * elapsed_s
        self._step, self._ids, self._rolled_m = states.step, states.actor_id, rolled
        return rolled
