"""Sensor suites, read from YAML: which sensors a vehicle or a roadside unit has, and where each of them is mounted.

The table of sensor types has the section in a suite's file, the specification, and the measurement of each type.
``SENSOR_MESSAGES`` in ``siren_ros.data.sensor_messages`` has the topic and the message of each type.
"""

import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, Final

from siren_ros.base.numerics.units import STEPS_PER_S
from siren_ros.base.params.parameters import FILES_ON_DISK, InputFiles, StrictMapping
from siren_ros.errors import InputError
from siren_ros.sensing.microphone import Microphone, MicrophoneSpec
from siren_ros.sensing.navigation import GeoReference, Gnss, GnssSpec, Imu, ImuSpec, PlanarMotion
from siren_ros.sensing.specification import RADIANS, CameraSpec, CarrierView, LidarSpec, Measure, Mount, SensorSpec
from siren_ros.simulation.roads.road_network import RoadNetwork
from siren_ros.simulation.world.carrier import ImuSample


@dataclass(frozen=True)
class SensorType:
    """One row of the table."""

    spec: type[SensorSpec]
    begin: Callable[[Any, RoadNetwork, int], Measure] | None = None
    """Makes the measuring function of a sensor from its specification, the map and the seed of the carrier's noise.
    None for LiDARs and cameras: the rig makes them, because they share one scene."""
    on_vehicles_only: bool = False
    casts: bool = False
    """Whether it measures with ``CarrierView.cast``: the rig then builds the scene also without LiDARs and cameras."""


def _gnss(spec: GnssSpec, network: RoadNetwork, seed: int) -> Measure:
    receiver = Gnss(spec, GeoReference.of(network), seed)
    return lambda view: receiver.measure(view.states.step, view.map_from_base)


def _imu(spec: ImuSpec, _: RoadNetwork, seed: int) -> Measure:
    unit = Imu(spec, seed)

    def measure(view: CarrierView) -> ImuSample:
        states, row = view.states, view.row
        values = (states.yaw_rad[row], states.vx_mps[row], states.vy_mps[row], states.yaw_rate_radps[row])
        return unit.measure(PlanarMotion(states.step, *map(float, values)))

    return measure


def _microphone(spec: MicrophoneSpec, _: RoadNetwork, seed: int) -> Measure:
    microphone = Microphone(spec, seed)
    return lambda view: microphone.hear(view.states, view.map_from_base)


SENSOR_TYPES: Final[dict[str, SensorType]] = {
    "lidars": SensorType(LidarSpec),
    "cameras": SensorType(CameraSpec),
    "gnss": SensorType(GnssSpec, _gnss, on_vehicles_only=True),
    "imus": SensorType(ImuSpec, _imu, on_vehicles_only=True),
    "microphones": SensorType(MicrophoneSpec, _microphone),
}
"""Sensor types by section of a suite's file. Mounts, topics and the messages of a step keep this order."""


EXPORTED_CAMERA: Final = "camera_front"
"""The camera whose pictures exports and videos use, if the suite has it."""


@dataclass(frozen=True)
class Station:
    """Place of a roadside suite on the ground. Its mounts are relative to this place."""

    place: Mount | None
    """Place in the ``map`` frame; None for the corner of the junction where the episode happens."""


@dataclass(frozen=True)
class SensorSuite:
    """All sensors of one carrier; names are unique and become topic and frame names."""

    name: str
    lidars: tuple[LidarSpec, ...] = ()
    cameras: tuple[CameraSpec, ...] = ()
    others: tuple[SensorSpec, ...] = ()
    """Sensors of all other types, in the order of ``SENSOR_TYPES``."""
    labels: bool = False
    """Whether boxes in the picture, visible fractions and truncations are recorded with each picture."""
    station: Station | None = None
    """Place of a roadside suite; None if the suite is mounted on a vehicle."""

    @property
    def common_period_steps(self) -> int:
        """Steps between the instants at which all LiDARs and cameras are due."""
        return math.lcm(*(spec.period_steps for spec in (*self.lidars, *self.cameras)))

    @property
    def mounts(self) -> tuple[tuple[str, Mount], ...]:
        """Name and place of every sensor."""
        return tuple((spec.name, spec.mount) for spec in (*self.lidars, *self.cameras, *self.others))


_AT_SITE: Final = "site"
_NAME: Final = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,63}")
MAX_SENSORS: Final = 32
"""Maximum number of sensors of a suite; it limits the memory that a suite can use."""
_MOUNT_KEYS: Final = {
    "x_m": ("x_m", 1.0, 20.0),
    "y_m": ("y_m", 1.0, 20.0),
    "z_m": ("z_m", 1.0, 20.0),
    "yaw_deg": ("yaw_rad", RADIANS, 360.0),
    "pitch_deg": ("pitch_rad", RADIANS, 90.0),
    "roll_deg": ("roll_rad", RADIANS, 180.0),
}
_MOUNT_PLACE: Final = ("x_m", "y_m", "z_m")
"""The keys of a mount that have no default."""
_FARTHEST_M: Final = 1e6


def load_suite(name_or_path: str, files: InputFiles = FILES_ON_DISK) -> SensorSuite:
    """A suite by name (``params/suites/NAME.yaml``) or from a YAML file of the user's own.

    Raises:
        InputError: No such suite, unreadable YAML, an unknown key, a value of the wrong type or out of range;
            the message names file, line, key, value and what is allowed.
    """
    top = files.read("sensors", "suites", name_or_path).mapping()
    sensors = {section: _specs(top, section) for section in SENSOR_TYPES}
    names = [spec.name for specs in sensors.values() for spec in specs]
    if len(names) > MAX_SENSORS:
        raise InputError(top.where(""), f"{len(names)} sensors", f"at most {MAX_SENSORS}")
    if twice := [name for name in names if names.count(name) > 1]:
        raise InputError(top.where("name"), twice[0], "each sensor name once")
    suite = SensorSuite(
        name=Path(name_or_path).stem,
        lidars=sensors.pop("lidars"),
        cameras=sensors.pop("cameras"),
        others=tuple(spec for specs in sensors.values() for spec in specs),
        labels=top.flag("labels", default=False),
        station=_station(top) if top.has("station") else None,
    )
    top.finish()
    moving = [section for section, row in SENSOR_TYPES.items() if row.on_vehicles_only]
    if suite.station is not None and any(sensors[section] for section in moving):
        raise InputError(
            top.where("station"), " or ".join(moving), f"a suite without {' and '.join(moving)}, which move"
        )
    return suite


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
    return Station(Mount(x_m, y_m, 0.0, yaw_deg * RADIANS))


def _mount(section: StrictMapping) -> Mount:
    values = {
        name: scale * section.number(key, -limit, limit)
        for key, (name, scale, limit) in _MOUNT_KEYS.items()
        if key in _MOUNT_PLACE or section.has(key)
    }
    section.finish()
    return Mount(**values)


def _specs(top: StrictMapping, section: str) -> tuple[Any, ...]:
    """All sensors of a section, in the order of the file."""
    sensors = top.mapping(section) if top.has(section) else None
    return tuple(_spec(SENSOR_TYPES[section].spec, name, sensors) for name in sensors.values) if sensors else ()


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
        raise InputError(wrong, spec.upper_fov_rad / RADIANS, "more than lower_fov_deg")
    return spec


def _value(section: StrictMapping, key: str, kind: Any, metadata: Mapping[str, Any]) -> float | bool | str:
    """A value checked against its field's type and bounds."""
    if kind is str:
        return section.text(key, metadata["choices"])
    if kind is bool:
        return section.flag(key)
    if kind is int:
        return section.integer(key, metadata["low"], metadata["high"])
    number = section.number(key, metadata["low"], metadata["high"])
    if metadata.get("rate") and (number <= 0 or abs(STEPS_PER_S / number - round(STEPS_PER_S / number)) > 1e-9):
        rates = ", ".join(f"{STEPS_PER_S / steps:g}" for steps in (1, 2, 4, 5, 10, 20))
        raise InputError(section.where(key), number, f"a rate that divides {STEPS_PER_S} Hz: {rates} …")
    return number * float(metadata["scale"])


@dataclass(frozen=True)
class LabelKinds:
    """Labels that are drawn with the colours. Semantic classes are always drawn."""

    depth: bool = False
    instance: bool = False
    boxes: bool = False

    @classmethod
    def of(cls, suite: SensorSuite, camera: CameraSpec) -> "LabelKinds":
        """Labels that a suite records for a camera."""
        return cls(camera.depth, camera.instance, suite.labels)
