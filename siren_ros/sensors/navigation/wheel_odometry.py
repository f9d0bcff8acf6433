"""Dead reckoning from wheel increments and a gyroscope: a pose that is smooth and drifts (REP 105's ``odom``)."""

from dataclasses import dataclass

import numpy as np

from siren_ros.numerics.arrays import Floats
from siren_ros.numerics.geometry import wrap_angle
from siren_ros.numerics.units import STEP_S
from siren_ros.sensors.suite.noise import sensor_generator
from siren_ros.world.carrier import Odometry


@dataclass(frozen=True)
class WheelOdometrySpec:
    """Errors of wheel odometry: two constants drawn once for an episode, and white noise.

    Tyre radii are known to about 0.5 % (load, pressure and wear change them); wheel speed sensors resolve a few cm/s.
    The gyroscope is an industrial MEMS unit with the errors of ``ImuSpec``: an in-run bias of 10 °/h and a noise
    density of 0.0035 °/s/√Hz over 10 Hz (VectorNav, VN-100 data sheet).
    """

    scale_stddev: float = 0.005
    """Of the scale of all distances, constant."""
    speed_noise_stddev_mps: float = 0.03
    gyro_bias_stddev_radps: float = 4.85e-5
    """Constant."""
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
    """Odometry of one vehicle; the ``odom`` frame lies where the vehicle is at the first step."""

    def __init__(self, seed: int, spec: WheelOdometrySpec | None = None) -> None:
        """Draw the constant errors; ``seed`` is that of the carrier's noise."""
        self._seed = seed
        self._spec = spec = spec or WheelOdometrySpec()
        draws = sensor_generator(seed, "odometry constants", 0).standard_normal(2)
        self._scale = 1.0 + float(draws[0]) * spec.scale_stddev
        self._gyro_bias_radps = float(draws[1]) * spec.gyro_bias_stddev_radps
        self._before: tuple[int, VehicleMotion] | None = None
        self._pose = (0.0, 0.0, 0.0)
        constants = np.diag([0.0, 0.0, 0.0, spec.scale_stddev**2, spec.gyro_bias_stddev_radps**2])
        self._covariance = constants + self._noise(STEP_S)
        """Of the errors of x, y, yaw, scale and gyro bias. At first the noise of one step: invertible."""

    def measure(self, step: int, now: VehicleMotion) -> Odometry:
        """The estimate at a step; call it at every step."""
        spec = self._spec
        draws = sensor_generator(self._seed, "odometry", step).standard_normal(3)
        slip_mps = draws[:2] * spec.speed_noise_stddev_mps
        spin_radps = self._gyro_bias_radps + float(draws[2]) * spec.gyro_noise_stddev_radps
        if self._before is not None:
            self._integrate(self._before[1], now, (step - self._before[0]) * STEP_S, slip_mps, spin_radps)
        self._before = step, now
        velocity = self._scale * np.array([now.forward_mps, now.left_mps]) + slip_mps
        twist_covariance = np.zeros((3, 3))
        twist_covariance[:2, :2] = np.outer(velocity, velocity) * spec.scale_stddev**2
        twist_covariance[:2, :2] += np.eye(2) * spec.speed_noise_stddev_mps**2
        twist_covariance[2, 2] = spec.gyro_bias_stddev_radps**2 + spec.gyro_noise_stddev_radps**2
        return Odometry(
            *self._pose,
            forward_mps=float(velocity[0]),
            left_mps=float(velocity[1]),
            yaw_rate_radps=now.yaw_rate_radps + spin_radps,
            pose_covariance=self._covariance[:3, :3].copy(),
            twist_covariance=twist_covariance,
        )

    def _integrate(
        self, before: VehicleMotion, now: VehicleMotion, elapsed_s: float, slip_mps: Floats, spin_radps: float
    ) -> None:
        """Add the increment since the step before, in the axes of that step, and propagate the covariance.

        P ← F P Fᵀ + Q with the Jacobian F of the motion model (Siegwart and Nourbakhsh, Introduction to Autonomous
        Mobile Robots, section 5.2.4), here with scale and gyro bias as further, constant states.
        """
        cos, sin = np.cos(before.yaw_rad), np.sin(before.yaw_rad)
        east, north = now.x_m - before.x_m, now.y_m - before.y_m
        increment = np.array([cos * east + sin * north, cos * north - sin * east])
        ahead, left = self._scale * increment + slip_mps * elapsed_s
        turn = float(wrap_angle(now.yaw_rad - before.yaw_rad)) + spin_radps * elapsed_s
        x_m, y_m, yaw_rad = self._pose
        cos, sin = np.cos(yaw_rad), np.sin(yaw_rad)
        dx, dy = float(cos * ahead - sin * left), float(sin * ahead + cos * left)
        self._pose = x_m + dx, y_m + dy, float(wrap_angle(yaw_rad + turn))
        jacobian = np.eye(5)
        jacobian[0, 2:4] = -dy, dx
        jacobian[1, 2:4] = dx, dy
        jacobian[2, 4] = elapsed_s
        propagated = jacobian @ self._covariance @ jacobian.T + self._noise(elapsed_s)
        self._covariance = (propagated + propagated.T) / 2.0

    def _noise(self, elapsed_s: float) -> Floats:
        """Covariance that the white noise of one increment adds, shape ``(5, 5)``."""
        slip, spin = self._spec.speed_noise_stddev_mps * elapsed_s, self._spec.gyro_noise_stddev_radps * elapsed_s
        return np.diag([slip**2, slip**2, spin**2, 0.0, 0.0])
