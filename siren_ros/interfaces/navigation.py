"""Inertial and satellite measurements: ``sensor_msgs/Imu`` and ``sensor_msgs/NavSatFix``."""

from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from siren_ros.interfaces.messages import header, make_message, time_ns_of
from siren_ros.interfaces.transforms import to_vector
from siren_ros.numerics.arrays import Floats
from siren_ros.numerics.units import step_of_time_ns, time_ns_of_step

_UNKNOWN: Final = -1.0
"""First element of a covariance whose quantity is not measured (``sensor_msgs/Imu``)."""
_STATUS_FIX: Final = 0
_SERVICE_GPS: Final = 1
_COVARIANCE_DIAGONAL_KNOWN: Final = 2


@dataclass(frozen=True, eq=False)
class ImuReading:
    """Specific force and angular rate in the sensor's axes, each of shape ``(3,)``, with their variances."""

    step: int
    frame_id: str
    specific_force_mps2: Floats
    angular_rate_radps: Floats
    force_variance: float
    rate_variance: float


@dataclass(frozen=True, eq=False)
class SatelliteFix:
    """A WGS 84 position; variances east, north, up in m², shape ``(3,)``."""

    step: int
    frame_id: str
    latitude_deg: float
    longitude_deg: float
    altitude_m: float
    variance_m2: Floats


def to_imu(reading: ImuReading) -> Any:
    """``sensor_msgs/Imu`` without an orientation, which this sensor does not estimate."""
    return make_message(
        "sensor_msgs/msg/Imu",
        header=header(time_ns_of_step(reading.step), reading.frame_id),
        orientation=make_message("geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=0.0, w=1.0),
        orientation_covariance=np.array([_UNKNOWN, *np.zeros(8)]),
        angular_velocity=to_vector(_triple(reading.angular_rate_radps)),
        angular_velocity_covariance=(np.eye(3) * reading.rate_variance).reshape(-1),
        linear_acceleration=to_vector(_triple(reading.specific_force_mps2)),
        linear_acceleration_covariance=(np.eye(3) * reading.force_variance).reshape(-1),
    )


def from_imu(message: Any) -> ImuReading:
    """Inverse of ``to_imu``."""
    force, rate = message.linear_acceleration, message.angular_velocity
    return ImuReading(
        step=step_of_time_ns(time_ns_of(message.header.stamp)),
        frame_id=str(message.header.frame_id),
        specific_force_mps2=np.array([force.x, force.y, force.z]),
        angular_rate_radps=np.array([rate.x, rate.y, rate.z]),
        force_variance=float(message.linear_acceleration_covariance[0]),
        rate_variance=float(message.angular_velocity_covariance[0]),
    )


def to_nav_sat_fix(fix: SatelliteFix) -> Any:
    """``sensor_msgs/NavSatFix``, covariance in east, north, up."""
    return make_message(
        "sensor_msgs/msg/NavSatFix",
        header=header(time_ns_of_step(fix.step), fix.frame_id),
        status=make_message("sensor_msgs/msg/NavSatStatus", status=_STATUS_FIX, service=_SERVICE_GPS),
        latitude=fix.latitude_deg,
        longitude=fix.longitude_deg,
        altitude=fix.altitude_m,
        position_covariance=np.diag(fix.variance_m2).reshape(-1),
        position_covariance_type=_COVARIANCE_DIAGONAL_KNOWN,
    )


def from_nav_sat_fix(message: Any) -> SatelliteFix:
    """Inverse of ``to_nav_sat_fix``."""
    return SatelliteFix(
        step=step_of_time_ns(time_ns_of(message.header.stamp)),
        frame_id=str(message.header.frame_id),
        latitude_deg=float(message.latitude),
        longitude_deg=float(message.longitude),
        altitude_m=float(message.altitude),
        variance_m2=np.asarray(message.position_covariance, dtype=np.float64).reshape(3, 3).diagonal().copy(),
    )


def _triple(values: Floats) -> tuple[float, float, float]:
    x, y, z = (float(value) for value in values)
    return x, y, z
