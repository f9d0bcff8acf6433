"""Specification of a sensor: its mount on the carrier, its parameters, and its random numbers.

Every sensor has a stream of random numbers of its own for every step.
"""

import zlib
from collections.abc import Callable
from dataclasses import MISSING, dataclass, field
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from siren_ros.base.numerics.arrays import Floats32, Matrix, Rows
from siren_ros.base.numerics.units import STEPS_PER_S
from siren_ros.simulation.world.actors import ActorStates
from siren_ros.simulation.world.carrier import CameraIntrinsics

RADIANS: Final = float(np.pi / 180.0)
"""One degree."""


def rotation_from_rpy(roll_rad: float, pitch_rad: float, yaw_rad: float) -> Matrix:
    """Rotation about x, then y, then z of the fixed axes (REP 103's roll, pitch, yaw), shape ``(3, 3)``."""
    cr, sr = np.cos(roll_rad), np.sin(roll_rad)
    cp, sp = np.cos(pitch_rad), np.sin(pitch_rad)
    cy, sy = np.cos(yaw_rad), np.sin(yaw_rad)
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def transform(rotation: Matrix, translation_m: npt.ArrayLike) -> Matrix:
    """Rigid transform ``[R t; 0 1]``, shape ``(4, 4)``."""
    matrix = np.eye(4)
    matrix[:3, :3] = rotation
    matrix[:3, 3] = translation_m
    return matrix


def map_from_base(x_m: float, y_m: float, z_m: float, yaw_rad: float) -> Matrix:
    """Transform that takes coordinates in an actor's ``base_link`` to the ``map`` frame, shape ``(4, 4)``."""
    return transform(rotation_from_rpy(0.0, 0.0, yaw_rad), (x_m, y_m, z_m))


def inverse(matrix: Matrix) -> Matrix:
    """Inverse of a rigid transform, shape ``(4, 4)``."""
    rotation = matrix[:3, :3].T
    return transform(rotation, -rotation @ matrix[:3, 3])


@dataclass(frozen=True)
class Mount:
    """A sensor's place in its carrier's ``base_link``: x forward, y left, z up, yaw counter-clockwise.

    A CARLA mount (y right, yaw clockwise, pitch up) becomes one of these by negating y, yaw and pitch; the
    origins agree, because CARLA's vehicle origin too is the footprint's centre on the ground.
    """

    x_m: float
    y_m: float
    z_m: float
    yaw_rad: float = 0.0
    pitch_rad: float = 0.0
    """Pitch of the sensor; positive looks down (REP 103)."""
    roll_rad: float = 0.0

    @property
    def base_from_sensor(self) -> Matrix:
        """Transform that takes sensor coordinates to ``base_link``, shape ``(4, 4)``."""
        rotation = rotation_from_rpy(self.roll_rad, self.pitch_rad, self.yaw_rad)
        return transform(rotation, (self.x_m, self.y_m, self.z_m))


OPTICAL_FROM_BODY = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])
"""Rotation from a camera's body frame (x forward, y left, z up) to its optical frame (z forward, x right, y down)."""
OPTICAL_FROM_BODY.setflags(write=False)


def optical_from_map(map_from_camera: Matrix) -> Matrix:
    """Transform into a camera's optical frame, given the pose of its body frame (x forward), ``(4, 4)``."""
    return transform(OPTICAL_FROM_BODY, np.zeros(3)) @ inverse(map_from_camera)


def sensor_generator(seed: int, sensor: str, step: int) -> np.random.Generator:
    """Random generator that depends on (seed, sensor, step) alone, so that no result depends on order or history."""
    name = zlib.crc32(sensor.encode())
    return np.random.Generator(np.random.SFC64(np.random.SeedSequence((seed, name, step))))


def number(low: float, high: float, default: Any = MISSING, key: str = "", scale: float = 1.0) -> Any:
    """A dataclass field that YAML gives as ``key`` within ``low … high``, multiplied by ``scale`` when read."""
    metadata = {"key": key, "low": low, "high": high, "scale": scale}
    return field(metadata=metadata) if default is MISSING else field(default=default, metadata=metadata)


def rate(default: float) -> Any:
    """A dataclass field for the measurements per second; the rate must divide the steps per second."""
    return field(default=default, metadata={"key": "", "low": 0.0, "high": STEPS_PER_S, "scale": 1.0, "rate": True})


@dataclass(frozen=True)
class SensorSpec:
    """Name and mount, which every sensor has."""

    name: str
    """Unique in its suite; becomes topic and frame name."""
    mount: Mount

    @property
    def period_steps(self) -> int:
        """Steps between two measurements; 1 for a sensor without ``rate_hz``, which divides the 20 Hz of the steps."""
        return round(STEPS_PER_S / getattr(self, "rate_hz", STEPS_PER_S))


@dataclass(frozen=True, eq=False)
class CarrierView:
    """Input of a sensor at one step: all actors, and which of them is its carrier."""

    states: ActorStates
    map_from_base: Matrix
    """Pose of the carrier, shape ``(4, 4)``."""
    row: int
    """Row of the carrier in the states; negative for a station."""
    cast: Callable[[Floats32], tuple[Floats32, Rows]]
    """Casts rays (origin and direction in the ``map`` frame, ``(N, 6)``) at the scene and all actors but the carrier,
    for sensors whose type says that they cast. Returns the distance to the first hit as a multiple of the direction,
    infinite where there is none, and the row of the actor hit in the states, -1 where it is none; both ``(N,)``."""


Measure = Callable[[CarrierView], Any]
"""Measures at a step; called at every step. It returns a frozen dataclass with ``step`` and ``frame_id`` (the sensor's
name)."""


POINT_LAYOUTS: Final = ("siren", "xyzirc", "xyzircaedt")


@dataclass(frozen=True)
class LidarSpec(SensorSpec):
    """A rotating LiDAR. Defaults other than the drop-off and the resolution: paper, table of the sensor suite.

    The drop-off and noise parameters mean what CARLA's documentation of ``sensor.lidar.ray_cast`` says. CARLA's
    default drops 45 % of the rays at random; here nothing is dropped unless a suite asks for it, so that
    every ray of the paper's 1.3 M points/s is cast.
    """

    channels: int = number(1, 256, 64)
    range_m: float = number(1.0, 300.0, 120.0)
    points_per_second: int = number(1_000, 10_000_000, 1_300_000)
    rate_hz: float = rate(20.0)
    """Rotations per second."""
    upper_fov_rad: float = number(-89.0, 89.0, 5.0 * RADIANS, "upper_fov_deg", RADIANS)
    lower_fov_rad: float = number(-89.0, 89.0, -25.0 * RADIANS, "lower_fov_deg", RADIANS)
    atmosphere_attenuation_per_m: float = number(0.0, 1.0, 0.004)
    """Attenuation in the air; CARLA's documented default."""
    noise_stddev_m: float = number(0.0, 1.0, 0.0)
    """Standard deviation of the range noise along the ray."""
    dropoff_general_rate: float = number(0.0, 1.0, 0.0)
    """Share of points dropped at random."""
    dropoff_intensity_limit: float = number(0.0, 1.0, 0.8)
    """Returns of this intensity and more are never dropped for weakness."""
    dropoff_zero_intensity: float = number(0.0, 1.0, 0.0)
    """Probability of dropping a point of zero intensity."""
    resolution_m: float = number(0.0, 0.1, 1.0 / 512.0)
    """Resolution of the coordinates, rounded to a power of two; 0 for no rounding. Real sensors resolve 2–4 mm."""
    motion_distortion: bool = False
    """Whether the carrier and the vehicles move while the beams turn."""
    points_layout: str = field(default=POINT_LAYOUTS[0], metadata={"choices": POINT_LAYOUTS})
    """Layout of the points in messages: with the actor that each point is on, or one of Autoware's."""

    @property
    def columns(self) -> int:
        """Firings per rotation: 1016 for the paper's sensor (1.3 M points/s / 20 Hz / 64 beams = 1015.6)."""
        return max(1, round(self.points_per_second / self.rate_hz / self.channels))


@dataclass(frozen=True)
class CameraSpec(SensorSpec):
    """A pinhole camera. Defaults: paper, table of the sensor suite; episodes are logged at 10 Hz."""

    width: int = number(16, 4096, 800)
    height: int = number(16, 4096, 600)
    horizontal_fov_rad: float = number(5.0, 160.0, 100.0 * RADIANS, "horizontal_fov_deg", RADIANS)
    rate_hz: float = rate(10.0)
    jpeg_quality: int = number(1, 100, 90)
    exposure: float = number(0.05, 20.0, 1.0)
    anti_aliasing: bool = True
    """Whether staircase edges are smoothed; labels are never smoothed."""
    noise_stddev: float = number(0.0, 50.0, 0.0)
    """Standard deviation of the noise added to each colour value, in steps of 1/255."""
    blur_px: float = number(0.0, 20.0, 0.0)
    """Standard deviation of a Gaussian blur."""
    depth: bool = False
    """Whether depth images are recorded; otherwise they are sent only while a subscriber listens. The next two fields
    are alike."""
    semantic: bool = False
    instance: bool = False

    @property
    def intrinsics(self) -> CameraIntrinsics:
        """Ideal pinhole model; the horizontal field of view spans the outer edges of the picture."""
        focal_px = self.width / 2.0 / float(np.tan(self.horizontal_fov_rad / 2.0))
        return CameraIntrinsics.centred(self.width, self.height, focal_px)
