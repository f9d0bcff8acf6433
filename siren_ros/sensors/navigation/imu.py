"""An inertial measurement unit: specific force and angular rate at its mount."""

from dataclasses import dataclass
from typing import Final

import numpy as np

from siren_ros.numerics.arrays import Floats
from siren_ros.numerics.units import STEP_S
from siren_ros.sensors.navigation.bias_walk import BiasWalk
from siren_ros.sensors.suite.noise import sensor_generator
from siren_ros.sensors.suite.suite import ImuSpec

STANDARD_GRAVITY_MPS2: Final = 9.80665
"""CGPM 1901."""


@dataclass(frozen=True)
class PlanarMotion:
    """Velocity of a carrier's ``base_link`` in the ``map`` frame, and its heading, at one step."""

    step: int
    yaw_rad: float
    vx_mps: float
    vy_mps: float
    yaw_rate_radps: float


@dataclass(frozen=True, eq=False)
class ImuSample:
    """One measurement in the sensor's axes."""

    sensor: str
    step: int
    specific_force_mps2: Floats
    """What accelerometers feel, shape ``(3,)``: acceleration less gravity, so (0, 0, 9.81) at rest and level."""
    angular_rate_radps: Floats
    """Shape ``(3,)``."""
    force_stddev_mps2: float
    rate_stddev_radps: float


def specific_force(before: PlanarMotion | None, now: PlanarMotion, lever_m: Floats) -> Floats:
    """Specific force at a point of a body that moves in the plane, in ``base_link``, shape ``(3,)``.

    f = Rᵀ (a + g e_z) + α × r + ω × (ω × r), with a and α as differences over the time since ``before``; zero where
    there is none (Groves, Principles of GNSS, Inertial and Multisensor Navigation Systems, 2nd ed., section 4.1 and
    eq. 2.161 for the lever arm).

    Args:
        before: Motion at an earlier step.
        now: Motion at the measured step.
        lever_m: Place of the sensor in ``base_link``, shape ``(3,)``.
    """
    ax = ay = spin = 0.0
    if before is not None and before.step < now.step:
        elapsed_s = (now.step - before.step) * STEP_S
        ax, ay = (now.vx_mps - before.vx_mps) / elapsed_s, (now.vy_mps - before.vy_mps) / elapsed_s
        spin = (now.yaw_rate_radps - before.yaw_rate_radps) / elapsed_s
    cos, sin = np.cos(now.yaw_rad), np.sin(now.yaw_rad)
    x, y, square = lever_m[0], lever_m[1], now.yaw_rate_radps**2
    return np.array(
        [
            cos * ax + sin * ay - spin * y - square * x,
            cos * ay - sin * ax + spin * x - square * y,
            STANDARD_GRAVITY_MPS2,
        ]
    )


class Imu:
    """One sensor on one carrier. It remembers the motion at the step before."""

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
        return ImuSample(
            sensor=spec.name,
            step=now.step,
            specific_force_mps2=sensor_from_base @ force + bias[:3] + noise[:3] * spec.accel_noise_stddev_mps2,
            angular_rate_radps=rate + bias[3:] + noise[3:] * spec.gyro_noise_stddev_radps,
            force_stddev_mps2=spec.accel_noise_stddev_mps2,
            rate_stddev_radps=spec.gyro_noise_stddev_radps,
        )
