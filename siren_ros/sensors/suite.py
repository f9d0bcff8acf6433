"""Sensor suites, read from YAML: which sensors a vehicle or a roadside unit has, and where each of them is mounted.

Every sensor has a stream of random numbers of its own for every step.
"""

import math
import re
import zlib
from collections.abc import Mapping
from dataclasses import MISSING, dataclass, field, fields
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from siren_ros.errors import InputError
from siren_ros.numerics.arrays import Matrix
from siren_ros.numerics.units import STEPS_PER_S
from siren_ros.params.input_files import FILES_ON_DISK, InputFiles
from siren_ros.params.resources import names_in_params
from siren_ros.params.strict_yaml import StrictMapping


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
    """Positive looks down (REP 103)."""
    roll_rad: float = 0.0

    @property
    def base_from_sensor(self) -> Matrix:
        """Transform that takes sensor coordinates to ``base_link``, shape ``(4, 4)``."""
        rotation = rotation_from_rpy(self.roll_rad, self.pitch_rad, self.yaw_rad)
        return transform(rotation, (self.x_m, self.y_m, self.z_m))


OPTICAL_FROM_BODY = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])
"""Rotation from a camera's body frame (x forward, y left, z up) to its optical frame (z forward, x right, y down)."""
OPTICAL_FROM_BODY.setflags(write=False)


_RADIANS: Final = float(np.pi / 180.0)
EXPORTED_CAMERA: Final = "camera_front"
"""The camera whose pictures go into exports and videos, where a suite has it."""


def _number(low: float, high: float, default: Any = MISSING, key: str = "", scale: float = 1.0) -> Any:
    """A dataclass field that YAML gives as ``key`` within ``low … high``, multiplied by ``scale`` when read."""
    metadata = {"key": key, "low": low, "high": high, "scale": scale}
    return field(metadata=metadata) if default is MISSING else field(default=default, metadata=metadata)


def _rate(default: float) -> Any:
    return field(default=default, metadata={"key": "", "low": 0.0, "high": STEPS_PER_S, "scale": 1.0, "rate": True})


@dataclass(frozen=True)
class SensorSpec:
    """Name and mount, which every sensor has."""

    name: str
    """Unique in its suite; becomes topic and frame name."""
    mount: Mount


@dataclass(frozen=True)
class LidarSpec(SensorSpec):
    """A rotating LiDAR. Defaults other than the drop-off and the resolution: paper, table of the sensor suite.

    The drop-off and noise parameters mean what CARLA's documentation of ``sensor.lidar.ray_cast`` says. CARLA's
    default drops 45 % of the rays at random; here nothing is dropped unless a suite asks for it, so that
    every ray of the paper's 1.3 M points/s is cast.
    """

    channels: int = _number(1, 256, 64)
    range_m: float = _number(1.0, 300.0, 120.0)
    points_per_second: int = _number(1_000, 10_000_000, 1_300_000)
    rate_hz: float = _rate(20.0)
    """Rotations per second."""
    upper_fov_rad: float = _number(-89.0, 89.0, 5.0 * _RADIANS, "upper_fov_deg", _RADIANS)
    lower_fov_rad: float = _number(-89.0, 89.0, -25.0 * _RADIANS, "lower_fov_deg", _RADIANS)
    atmosphere_attenuation_per_m: float = _number(0.0, 1.0, 0.004)
    """CARLA's documented default."""
    noise_stddev_m: float = _number(0.0, 1.0, 0.0)
    """Standard deviation of the range noise along the ray."""
    dropoff_general_rate: float = _number(0.0, 1.0, 0.0)
    """Share of points dropped at random."""
    dropoff_intensity_limit: float = _number(0.0, 1.0, 0.8)
    """At this intensity and above nothing is dropped for weakness."""
    dropoff_zero_intensity: float = _number(0.0, 1.0, 0.0)
    """Probability of dropping a point of zero intensity."""
    resolution_m: float = _number(0.0, 0.1, 1.0 / 512.0)
    """Grid of the coordinates, rounded to a power of two; 0 leaves them as they are. Real sensors resolve 2–4 mm."""
    motion_distortion: bool = False
    """Whether the carrier and the vehicles move while the beams turn."""

    @property
    def columns(self) -> int:
        """Firings per rotation: 1016 for the paper's sensor (1.3 M points/s / 20 Hz / 64 beams = 1015.6)."""
        return max(1, round(self.points_per_second / self.rate_hz / self.channels))


@dataclass(frozen=True)
class CameraSpec(SensorSpec):
    """A pinhole camera. Defaults: paper, table of the sensor suite; episodes are logged at 10 Hz."""

    width: int = _number(16, 4096, 800)
    height: int = _number(16, 4096, 600)
    horizontal_fov_rad: float = _number(5.0, 160.0, 100.0 * _RADIANS, "horizontal_fov_deg", _RADIANS)
    rate_hz: float = _rate(10.0)
    jpeg_quality: int = _number(1, 100, 90)
    exposure: float = _number(0.05, 20.0, 1.0)
    noise_stddev: float = _number(0.0, 50.0, 0.0)
    """Standard deviation of the noise added to each colour value, in steps of 1/255."""
    blur_px: float = _number(0.0, 20.0, 0.0)
    """Standard deviation of a Gaussian blur."""
    depth: bool = False
    """Whether depth images are recorded; without, they are sent while somebody listens. Likewise the next two."""
    semantic: bool = False
    instance: bool = False


@dataclass(frozen=True)
class GnssSpec(SensorSpec):
    """A GNSS receiver: white noise and a bias that walks, per axis.

    Defaults: an RTK receiver, 0.01 m circular error probable and 0.01 m vertical R50 (u-blox, ZED-F9P data sheet,
    position accuracy RTK); for normal errors CEP is 1.1774 and R50 0.6745 standard deviations. The walk reaches
    2.5 cm within 100 s, of the order of RTK's 1 ppm over the baselines of a town's network.
    """

    rate_hz: float = _rate(10.0)
    horizontal_noise_stddev_m: float = _number(0.0, 50.0, 0.0085)
    vertical_noise_stddev_m: float = _number(0.0, 50.0, 0.0148)
    bias_walk_m_per_sqrt_s: float = _number(0.0, 10.0, 0.0025)


@dataclass(frozen=True)
class ImuSpec(SensorSpec):
    """An IMU: white noise and a bias that walks, per axis.

    Defaults: an industrial MEMS unit, noise densities 0.14 mg/√Hz and 0.0035 °/s/√Hz (VectorNav, VN-100 data sheet)
    over the 10 Hz of bandwidth that 20 Hz leave; the biases walk by its in-run stabilities, 0.04 mg and
    10 °/h, within 100 s.
    """

    rate_hz: float = _rate(20.0)
    accel_noise_stddev_mps2: float = _number(0.0, 10.0, 4.3e-3)
    gyro_noise_stddev_radps: float = _number(0.0, 10.0, 1.9e-4)
    accel_bias_walk_mps2_per_sqrt_s: float = _number(0.0, 1.0, 3.9e-5)
    gyro_bias_walk_radps_per_sqrt_s: float = _number(0.0, 1.0, 4.8e-6)


@dataclass(frozen=True)
class MicrophoneSpec(SensorSpec):
    """An omnidirectional microphone that records a chunk of 16-bit PCM at every step."""

    sample_rate_hz: int = _number(8_000, 48_000, 16_000)
    full_scale_db: float = _number(60.0, 160.0, 130.0)
    """Sound pressure level of a sine at full scale, dB re 20 µPa."""
    noise_db: float = _number(0.0, 120.0, 45.0)
    """Level of the background noise, dB re 20 µPa; 0 switches it off."""


@dataclass(frozen=True)
class Station:
    """Where a roadside suite stands. Its mounts are relative to this place on the ground."""

    place: Mount | None
    """In the ``map`` frame; None: the corner of the junction where the episode happens."""


@dataclass(frozen=True)
class SensorSuite:
    """All sensors of one carrier; names are unique and become topic and frame names."""

    name: str
    lidars: tuple[LidarSpec, ...] = ()
    cameras: tuple[CameraSpec, ...] = ()
    gnss: tuple[GnssSpec, ...] = ()
    imus: tuple[ImuSpec, ...] = ()
    microphones: tuple[MicrophoneSpec, ...] = ()
    labels: bool = False
    """Whether boxes in the pictures, visible fractions and truncations are recorded with each picture."""
    station: Station | None = None
    """None: the suite is mounted on a vehicle."""

    @property
    def common_period_steps(self) -> int:
        """Steps between the instants at which all LiDARs and cameras are due."""
        rates_hz = [*(one.rate_hz for one in self.lidars), *(one.rate_hz for one in self.cameras)]
        return math.lcm(*map(period_steps, rates_hz))

    @property
    def mounts(self) -> tuple[tuple[str, Mount], ...]:
        """Name and place of every sensor."""
        every = (*self.lidars, *self.cameras, *self.gnss, *self.imus, *self.microphones)
        return tuple((spec.name, spec.mount) for spec in every)


_KINDS: Final[dict[str, type[Any]]] = {
    "lidars": LidarSpec,
    "cameras": CameraSpec,
    "gnss": GnssSpec,
    "imus": ImuSpec,
    "microphones": MicrophoneSpec,
}
_AT_SITE: Final = "site"
_NAME: Final = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,63}")
MAX_SENSORS: Final = 32
"""Bounds the memory that a suite can ask for."""
_MOUNT_KEYS: Final = {
    "x_m": ("x_m", 1.0, 20.0),
    "y_m": ("y_m", 1.0, 20.0),
    "z_m": ("z_m", 1.0, 20.0),
    "yaw_deg": ("yaw_rad", _RADIANS, 360.0),
    "pitch_deg": ("pitch_rad", _RADIANS, 90.0),
    "roll_deg": ("roll_rad", _RADIANS, 180.0),
}
_MOUNT_PLACE: Final = ("x_m", "y_m", "z_m")
"""The keys of a mount that have no default."""
_FARTHEST_M: Final = 1e6


def period_steps(rate_hz: float) -> int:
    """Steps between two measurements of a sensor; the rate divides the 20 Hz of the steps."""
    return round(STEPS_PER_S / rate_hz)


def suite_names() -> tuple[str, ...]:
    """Names of the suites that come with the project, sorted."""
    return names_in_params("suites")


def load_suite(name_or_path: str, files: InputFiles = FILES_ON_DISK) -> SensorSuite:
    """A suite by name (``params/suites/NAME.yaml``) or from a YAML file of the user's own.

    Raises:
        InputError: No such suite, unreadable YAML, an unknown key, a value of the wrong type or out of range;
            the message names file, line, key, value and what is allowed.
    """
    top = files.read("sensors", "suites", name_or_path).mapping()
    sensors = {kind: _specs(top, kind) for kind in _KINDS}
    _check_names(top, [spec.name for specs in sensors.values() for spec in specs])
    suite = SensorSuite(
        name=Path(name_or_path).stem,
        labels=top.flag("labels", default=False),
        station=_station(top) if top.has("station") else None,
        **sensors,
    )
    top.finish()
    if suite.station is not None and (suite.gnss or suite.imus):
        raise InputError(top.where("station"), "gnss or imus", "a suite without gnss and imus, which move")
    return suite


def _check_names(top: StrictMapping, names: list[str]) -> None:
    if len(names) > MAX_SENSORS:
        raise InputError(top.where(""), f"{len(names)} sensors", f"at most {MAX_SENSORS}")
    for name in names:
        if names.count(name) > 1:
            raise InputError(top.where("name"), name, "each sensor name once")


def _station(top: StrictMapping) -> Station:
    if not top.is_mapping("station"):
        place = top.text("station")
        if place != _AT_SITE:
            raise InputError(top.where("station"), place, f"{_AT_SITE}, or a mapping of x_m, y_m and yaw_deg (map)")
        return Station(None)
    section = top.mapping("station")
    x_m, y_m = (section.number(key, -_FARTHEST_M, _FARTHEST_M) for key in ("x_m", "y_m"))
    yaw_deg = section.number("yaw_deg", -360.0, 360.0) if section.has("yaw_deg") else 0.0
    section.finish()
    return Station(Mount(x_m, y_m, 0.0, yaw_deg * _RADIANS))


def _mount(section: StrictMapping) -> Mount:
    values = {
        name: scale * section.number(key, -limit, limit)
        for key, (name, scale, limit) in _MOUNT_KEYS.items()
        if key in _MOUNT_PLACE or section.has(key)
    }
    section.finish()
    return Mount(**values)


def _specs(top: StrictMapping, kind: str) -> tuple[Any, ...]:
    """All sensors of a kind, in the order of the file."""
    if not top.has(kind):
        return ()
    section = top.mapping(kind)
    return tuple(_spec(_KINDS[kind], name, section) for name in section.values)


def _spec(kind: type[Any], name: str, sensors: StrictMapping) -> Any:
    """One sensor from its YAML mapping."""
    if not _NAME.fullmatch(name) or "__" in name:
        allowed = "a name of letters, digits and single underscores, at most 64, not a digit first"
        raise InputError(sensors.where(name), name, allowed)
    section = sensors.mapping(name)
    values: dict[str, Any] = {"mount": _mount(section.mapping("mount"))}
    for item in fields(kind):
        key = item.metadata.get("key") or item.name
        if item.name not in {"name", "mount"} and section.has(key):
            values[item.name] = _value(section, key, item.type, item.metadata)
    section.finish()
    spec = kind(name=name, **values)
    if isinstance(spec, LidarSpec) and spec.channels > 1 and spec.upper_fov_rad <= spec.lower_fov_rad:
        wrong = section.where("upper_fov_deg")
        raise InputError(wrong, spec.upper_fov_rad / _RADIANS, "more than lower_fov_deg")
    return spec


def _value(section: StrictMapping, key: str, kind: Any, metadata: Mapping[str, Any]) -> float | bool:
    """A value checked against its field's type and bounds."""
    if kind is bool:
        return section.flag(key)
    if kind is int:
        return section.integer(key, metadata["low"], metadata["high"])
    number = section.number(key, metadata["low"], metadata["high"])
    if metadata.get("rate") and (number <= 0 or abs(STEPS_PER_S / number - round(STEPS_PER_S / number)) > 1e-9):
        rates = ", ".join(f"{STEPS_PER_S / steps:g}" for steps in (1, 2, 4, 5, 10, 20))
        raise InputError(section.where(key), number, f"a rate that divides {STEPS_PER_S} Hz: {rates} …")
    return number * float(metadata["scale"])


def sensor_generator(seed: int, sensor: str, step: int) -> np.random.Generator:
    """Generator that depends on (seed, sensor, step) alone, so that results do not depend on order or history."""
    name = zlib.crc32(sensor.encode())
    return np.random.Generator(np.random.SFC64(np.random.SeedSequence((seed, name, step))))


@dataclass(frozen=True)
class WantedLabels:
    """Labels to draw with the colours. Semantic classes are always drawn."""

    depth: bool = False
    instance: bool = False
    boxes: bool = False

    @classmethod
    def of(cls, suite: SensorSuite, camera: CameraSpec) -> "WantedLabels":
        """Labels that a suite records of a camera."""
        return cls(camera.depth, camera.instance, suite.labels)
