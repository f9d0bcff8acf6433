"""Reduces sensor data for a page: LiDAR points around the carrier, and camera pictures.

Of the points one stays in each cube of 0.3 m; pictures get smaller. Where it is more than a page may hold, time is
thinned.
"""

import io
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import chain, groupby
from pathlib import Path
from typing import Any, Final, Protocol, TypeVar

import numpy as np
import numpy.typing as npt
import simplejpeg
from PIL import Image

from siren_ros.base.numerics.arrays import Matrix, Points
from siren_ros.base.numerics.units import STEP_S
from siren_ros.data.episode_source import EpisodeSource, MountedSensor, open_source
from siren_ros.data.interfaces.measurements import from_compressed_image, from_point_cloud, from_tf, matrix_between
from siren_ros.data.interfaces.topics import TF
from siren_ros.data.recording.bag_reader import BagMessage, damage_refused
from siren_ros.data.sensor_messages.sensor_topics import AV, EMV
from siren_ros.errors import BagError, InputError, shown_text
from siren_ros.reports.episode_page.columns import MEDIUM, ColumnFile
from siren_ros.simulation.world.carrier import BASE_FRAME, MAP_FRAME

ALL: Final = "all"
MOST_MB: Final = 20.0
PERIODS_STEPS: Final = (4, 10, 20, 40, 100, 200)
"""Possible steps between two sweeps or pictures: 0.2 s, or more if these are too many."""
CUBE_M: Final = 0.3
UNIT_M: Final = 0.01
"""Unit of a point's coordinates."""
_FARTHEST_M: Final = 320.0
"""Largest coordinate that a 16-bit column holds in centimetres."""
_WIDTH_PX: Final = 480
_QUALITY: Final = 75
_LARGEST_PX: Final = 8192
_IN_PAGE: Final = 4.0 / 3.0
"""Letters of base64 per byte."""


class _Timed(Protocol):
    """Protocol of an item that belongs to a step."""

    @property
    def step(self) -> int:
        """Step of the measurement."""

    @property
    def size_bytes(self) -> int:
        """Size of the item in the page."""


Item = TypeVar("Item", bound=_Timed)


@dataclass(frozen=True, eq=False)
class Sweep:
    """Thinned points of one sweep."""

    step: int
    origin_m: tuple[float, float, float]
    """Position of the carrier in the map, in whole centimetres."""
    counts: npt.NDArray[np.int64]
    """Positions of the points relative to it along the map's axes, in multiples of ``UNIT_M``, shape ``(N, 3)``."""
    measured: int
    """Number of points before thinning."""

    @cached_property
    def size_bytes(self) -> int:
        """Size of its columns, compressed."""
        file = ColumnFile()
        _add_points(file, [self])
        return round(_IN_PAGE * len(file.packed({}, MEDIUM)))


@dataclass(frozen=True)
class Shot:
    """One picture of a camera."""

    step: int
    jpeg: bytes

    @property
    def size_bytes(self) -> int:
        """Size in base64."""
        return round(_IN_PAGE * len(self.jpeg))


@dataclass(frozen=True)
class Sensed:
    """Sensor data of an episode that a page shows."""

    sweeps: Mapping[str, tuple[Sweep, ...]] = field(default_factory=dict)
    """Sweeps by the LiDAR's name."""
    pictures: Mapping[str, tuple[Shot, ...]] = field(default_factory=dict)
    """Pictures by the camera's name."""
    notes: tuple[tuple[str, str], ...] = ()
    """For each sensor's name, what is included and what was left out."""


NOTHING: Final = Sensed()


def sensed_of(path: Path, names: Sequence[str], most_mb: float = MOST_MB) -> Sensed:
    """Sensor data of a bag, limited to a size in the page.

    Args:
        path: The bag.
        names: Names of first LiDARs and of cameras, of the EMV or the AV under test, or ``ALL``.
        most_mb: Size by which the page may grow.

    Raises:
        InputError: The bag does not have one of the sensors.
        BagError: The bag is damaged.
    """
    with open_source(path) as source:
        sensors = _chosen(source, names)
        sensed = _read(source, sensors)
    items: list[_Timed]
    for period in PERIODS_STEPS:
        sensed = replace(
            sensed,
            sweeps={name: thinned(sweeps, period) for name, sweeps in sensed.sweeps.items()},
            pictures={name: thinned(shots, period) for name, shots in sensed.pictures.items()},
        )
        items = [*chain(*sensed.sweeps.values()), *chain(*sensed.pictures.values())]
        if sum(item.size_bytes for item in items) <= 1e6 * most_mb:
            return replace(sensed, notes=tuple(_notes(sensed, sensors, period, most_mb)))
    return Sensed(notes=tuple((shown_text(sensor.name), f"left out: more than {most_mb:g} MB") for sensor in sensors))


def _lidars(source: EpisodeSource) -> list[MountedSensor]:
    lidars = (source.lidar_on(carrier) for carrier in (EMV, AV))
    return [lidar for lidar in lidars if lidar]


def _chosen(source: EpisodeSource, names: Sequence[str]) -> tuple[MountedSensor, ...]:
    cameras = [camera for carrier in (EMV, AV) for camera in source.cameras_on(carrier)]
    known = {sensor.name: sensor for sensor in (*_lidars(source), *cameras)}
    wanted = tuple(known) if ALL in names else tuple(dict.fromkeys(names))
    for name in wanted:
        if name not in known:
            has = f"of those of the bag: {', '.join(known)}" if known else "none: the bag has no LiDAR and no camera"
            raise InputError("sensors", name, has)
    return tuple(known[name] for name in wanted)


def _read(source: EpisodeSource, sensors: Iterable[MountedSensor]) -> Sensed:
    """First sweep or picture of each sensor in each of the shortest periods."""
    lidars = {lidar.topic for lidar in _lidars(source)}
    sweeps: dict[str, list[Sweep]] = {sensor.name: [] for sensor in sensors if sensor.topic in lidars}
    pictures: dict[str, list[Shot]] = {sensor.name: [] for sensor in sensors if sensor.topic not in lidars}
    read: dict[str, int] = {}
    for step, held in source.messages_by_step({TF.name, *(sensor.topic for sensor in sensors)}):
        with damage_refused(source.path):
            for sensor in sensors:
                period = step // PERIODS_STEPS[0]
                if sensor.topic not in held or read.get(sensor.topic) == period:
                    continue
                read[sensor.topic] = period
                message = held[sensor.topic].read()
                if sensor.name in pictures:
                    pictures[sensor.name].append(Shot(step, smaller(from_compressed_image(message))))
                else:
                    place = _place(source, sensor, held)
                    points = from_point_cloud(message)
                    xyz = np.stack([points[axis].astype(np.float64) for axis in "xyz"], axis=-1)
                    sweeps[sensor.name].append(sweep_of(step, xyz, place, place @ sensor.base_from_sensor))
    return Sensed(
        {name: tuple(items) for name, items in sweeps.items()},
        {name: tuple(shots) for name, shots in pictures.items()},
    )


def _place(source: EpisodeSource, sensor: MountedSensor, held: Mapping[str, BagMessage]) -> Matrix:
    """Pose in the map of a sensor's carrier."""
    if source.station is not None and sensor.base_frame == BASE_FRAME:
        return source.station
    if TF.name not in held:
        raise BagError(str(source.path), f"an episode with the sensors' pose on {TF.name} at each sweep")
    return matrix_between(from_tf(held[TF.name].read()), MAP_FRAME, sensor.base_frame)


def sweep_of(step: int, xyz_m: Points, map_from_base: Matrix, map_from_lidar: Matrix) -> Sweep:
    """Make a sweep from points in the LiDAR's frame; one point per cube around the carrier remains."""
    origin_m = np.round(map_from_base[:3, 3], 2)
    places_m = xyz_m @ map_from_lidar[:3, :3].T + map_from_lidar[:3, 3] - origin_m
    places_m = places_m[(np.abs(places_m) < _FARTHEST_M).all(axis=1)]
    cells = np.floor(places_m / CUBE_M).astype(np.int64) + round(_FARTHEST_M / CUBE_M) + 1
    _, first = np.unique(cells @ (1 << 40, 1 << 20, 1), return_index=True)
    counts = np.rint(places_m[first] / UNIT_M).astype(np.int64)
    x_m, y_m, z_m = origin_m.tolist()
    return Sweep(step, (x_m, y_m, z_m), counts, len(xyz_m))


def smaller(jpeg: bytes) -> bytes:
    """Reduce a picture to at most 480 pixels width; ValueError if it is not a JPEG or is enormous."""
    height, width, *_ = simplejpeg.decode_jpeg_header(jpeg)
    if not 0 < max(height, width) <= _LARGEST_PX:
        raise ValueError(f"a picture of {width} × {height} pixels")
    share = min(_WIDTH_PX / width, 1.0)
    size = max(round(share * width), 1), max(round(share * height), 1)
    pixels = simplejpeg.decode_jpeg(jpeg, "RGB", min_width=size[0], min_height=size[1], min_factor=1.0)
    out = io.BytesIO()
    Image.fromarray(pixels).resize(size).save(out, "JPEG", quality=_QUALITY, optimize=True)
    return out.getvalue()


def thinned(items: Iterable[Item], period: int) -> tuple[Item, ...]:
    """The first item of each period."""
    return tuple(next(those) for _, those in groupby(items, lambda item: item.step // period))


def _notes(sensed: Sensed, sensors: Iterable[MountedSensor], period: int, most_mb: float) -> Iterable[tuple[str, str]]:
    why = f", so that they fit into {most_mb:g} MB" if period > PERIODS_STEPS[0] else ""
    for sensor in sensors:
        shots = sensed.pictures.get(sensor.name)
        if shots is None:
            sweeps = sensed.sweeps[sensor.name]
            kept = np.mean([len(sweep.counts) for sweep in sweeps] or [0])
            measured = np.mean([sweep.measured for sweep in sweeps] or [0])
            points = f"{kept:,.0f} of {measured:,.0f} points, one in {CUBE_M:g} m"
            yield shown_text(sensor.name), f"a sweep every {period * STEP_S:g} s{why}, {points}"
        else:
            yield (
                shown_text(sensor.name),
                f"a picture every {period * STEP_S:g} s{why}, at most {_WIDTH_PX} pixels wide",
            )


def add_sensed(file: ColumnFile, sensed: Sensed) -> dict[str, Any]:
    """Add the columns ``sweep.*`` and ``pictures.*``; returns their entry for the head, empty without data."""
    if not any(sensed.sweeps.values()) and not any(sensed.pictures.values()):
        return {}
    lidars, cameras = [], []
    for place, (name, sweeps) in enumerate(sensed.sweeps.items()):
        _add_points(file, sweeps, f"sweep.{place}")
        rows = [[sweep.step, len(sweep.counts), *sweep.origin_m] for sweep in sweeps]
        lidars.append({"name": shown_text(name), "sweeps": rows})
    for place, (name, shots) in enumerate(sensed.pictures.items()):
        file.add_bytes(f"pictures.{place}", b"".join(shot.jpeg for shot in shots))
        cameras.append({"name": shown_text(name), "shots": [[shot.step, len(shot.jpeg)] for shot in shots]})
    return {"sensed": {"lidars": lidars, "cameras": cameras}}


def _add_points(file: ColumnFile, sweeps: Sequence[Sweep], name: str = "") -> None:
    counts = np.concatenate([sweep.counts for sweep in sweeps]) if sweeps else np.empty((0, 3))
    for axis, values in zip("xyz", counts.T, strict=True):
        file.add(f"{name}.{axis}", values * UNIT_M, UNIT_M, width=2)
