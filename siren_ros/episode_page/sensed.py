"""What an episode's sensors measured, as little as a page needs: LiDAR points around the carrier, camera pictures.

Of the points one stays in each cube of 0.3 m; pictures get smaller. Where it is more than a page may hold, time is
thinned.
"""

import io
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Final, Protocol, TypeVar

import numpy as np
import numpy.typing as npt
import simplejpeg
from PIL import Image

from siren_ros.episode_page.columns import ColumnFile
from siren_ros.errors import BagError, InputError
from siren_ros.interfaces.measurements import from_compressed_image, from_point_cloud
from siren_ros.interfaces.messages import shown_text
from siren_ros.interfaces.topics import TF
from siren_ros.interfaces.transforms import from_tf, matrix_between
from siren_ros.numerics.arrays import Matrix, Points
from siren_ros.numerics.units import STEP_S
from siren_ros.record.episode_source import EpisodeSource, MountedSensor, open_source
from siren_ros.recording.bag_reader import BagMessage, damage_refused
from siren_ros.world.carrier import BASE_FRAME, MAP_FRAME

ALL: Final = "all"
MOST_MB: Final = 20.0
PERIODS_STEPS: Final = (4, 10, 20, 40, 100, 200)
"""Between two sweeps or pictures: 0.2 s, and more where these are too many."""
CUBE_M: Final = 0.3
UNIT_M: Final = 0.01
"""Of a point's place."""
_FARTHEST_M: Final = 1000.0
_WIDTH_PX: Final = 480
_QUALITY: Final = 75
_LARGEST_PX: Final = 8192
_IN_PAGE: Final = 4.0 / 3.0
"""Letters of base64 for a byte."""


class _Timed(Protocol):
    """Something at a step."""

    @property
    def step(self) -> int:
        """When it was measured."""

    @property
    def size_bytes(self) -> int:
        """How much of the page it takes."""


Item = TypeVar("Item", bound=_Timed)


@dataclass(frozen=True, eq=False)
class Sweep:
    """The points of one sweep, thinned."""

    step: int
    origin_m: tuple[float, float, float]
    """The carrier's place in the map, in whole centimetres."""
    counts: npt.NDArray[np.int64]
    """Places from there along the map's axes in multiples of ``UNIT_M``, shape ``(N, 3)``."""
    measured: int
    """Number of points before they were thinned."""

    @cached_property
    def size_bytes(self) -> int:
        """Of its own columns, compressed."""
        file = ColumnFile()
        _add_points(file, [self])
        return round(_IN_PAGE * len(file.packed({})))


@dataclass(frozen=True)
class Shot:
    """One picture of a camera."""

    step: int
    jpeg: bytes

    @property
    def size_bytes(self) -> int:
        """In base64."""
        return round(_IN_PAGE * len(self.jpeg))


@dataclass(frozen=True)
class Sensed:
    """What a page shows of an episode's sensors."""

    sweeps: tuple[Sweep, ...] = ()
    pictures: Mapping[str, tuple[Shot, ...]] = field(default_factory=dict)
    """By the camera's name."""
    notes: tuple[tuple[str, str], ...] = ()
    """By the sensor's name what of it is there, and what was left out."""


NOTHING: Final = Sensed()


def sensed_of(path: Path, names: Sequence[str], most_mb: float = MOST_MB) -> Sensed:
    """What some sensors of a bag measured, in at most so many megabytes of a page.

    Args:
        path: The bag.
        names: Of its first LiDAR and of cameras, or ``ALL``.
        most_mb: The size that the page may grow by.

    Raises:
        InputError: A sensor that the bag does not have.
        BagError: A damaged bag.
    """
    with open_source(path) as source:
        sensors = _chosen(source, names)
        sensed = _read(source, sensors)
    items: list[_Timed]
    for period in PERIODS_STEPS:
        sensed = replace(
            sensed,
            sweeps=thinned(sensed.sweeps, period),
            pictures={name: thinned(shots, period) for name, shots in sensed.pictures.items()},
        )
        items = [*sensed.sweeps, *(shot for shots in sensed.pictures.values() for shot in shots)]
        if sum(item.size_bytes for item in items) <= 1e6 * most_mb:
            return replace(sensed, notes=tuple(_notes(sensed, sensors, period, most_mb)))
    return Sensed(notes=tuple((shown_text(sensor.name), f"left out: more than {most_mb:g} MB") for sensor in sensors))


def _chosen(source: EpisodeSource, names: Sequence[str]) -> tuple[MountedSensor, ...]:
    known = {sensor.name: sensor for sensor in (*((source.lidar,) if source.lidar else ()), *source.cameras)}
    wanted = tuple(known) if ALL in names else tuple(dict.fromkeys(names))
    for name in wanted:
        if name not in known:
            has = f"of those of the bag: {', '.join(known)}" if known else "none: the bag has no LiDAR and no camera"
            raise InputError("sensors", name, has)
    return tuple(known[name] for name in wanted)


def _read(source: EpisodeSource, sensors: Iterable[MountedSensor]) -> Sensed:
    lidar = next((sensor for sensor in sensors if source.lidar and sensor.topic == source.lidar.topic), None)
    cameras = [sensor for sensor in sensors if sensor is not lidar]
    due = dict.fromkeys((sensor.topic for sensor in sensors), 0)
    sweeps: list[Sweep] = []
    pictures: dict[str, list[Shot]] = {camera.name: [] for camera in cameras}
    for step, held in source.messages_by_step({TF.name, *due}):
        now = {topic for topic, next_step in due.items() if topic in held and step >= next_step}
        due.update(dict.fromkeys(now, _after(step, PERIODS_STEPS[0])))
        with damage_refused(source.path):
            if lidar is not None and lidar.topic in now:
                place = _place(source, held)
                points = from_point_cloud(held[lidar.topic].read())
                xyz = np.stack([points[axis].astype(np.float64) for axis in "xyz"], axis=-1)
                sweeps.append(sweep_of(step, xyz, place, place @ lidar.base_from_sensor))
            for camera in cameras:
                if camera.topic in now:
                    jpeg = smaller(from_compressed_image(held[camera.topic].read()))
                    pictures[camera.name].append(Shot(step, jpeg))
    return Sensed(tuple(sweeps), {name: tuple(shots) for name, shots in pictures.items()})


def _place(source: EpisodeSource, held: Mapping[str, BagMessage]) -> Matrix:
    """The carrier in the map."""
    if source.station is not None:
        return source.station
    if TF.name not in held:
        raise BagError(str(source.path), f"an episode with the sensors' pose on {TF.name} at each sweep")
    return matrix_between(from_tf(held[TF.name].read()), MAP_FRAME, BASE_FRAME)


def sweep_of(step: int, xyz_m: Points, map_from_base: Matrix, map_from_lidar: Matrix) -> Sweep:
    """A sweep of points in the LiDAR's frame; one of them stays in each cube around the carrier."""
    origin_m = np.round(map_from_base[:3, 3], 2)
    places_m = xyz_m @ map_from_lidar[:3, :3].T + map_from_lidar[:3, 3] - origin_m
    places_m = places_m[(np.abs(places_m) < _FARTHEST_M).all(axis=1)]
    cells = np.floor(places_m / CUBE_M).astype(np.int64) + round(_FARTHEST_M / CUBE_M) + 1
    _, first = np.unique(cells @ (1 << 40, 1 << 20, 1), return_index=True)
    counts = np.rint(places_m[first] / UNIT_M).astype(np.int64)
    x_m, y_m, z_m = origin_m.tolist()
    return Sweep(step, (x_m, y_m, z_m), counts, len(xyz_m))


def smaller(jpeg: bytes) -> bytes:
    """A picture of at most 480 pixels' width; ValueError for one that is no JPEG or enormous."""
    height, width, *_ = simplejpeg.decode_jpeg_header(jpeg)
    if not 0 < max(height, width) <= _LARGEST_PX:
        raise ValueError(f"a picture of {width} × {height} pixels")
    share = min(_WIDTH_PX / width, 1.0)
    size = max(round(share * width), 1), max(round(share * height), 1)
    pixels = simplejpeg.decode_jpeg(jpeg, "RGB", min_width=size[0], min_height=size[1], min_factor=1.0)
    out = io.BytesIO()
    Image.fromarray(pixels).resize(size).save(out, "JPEG", quality=_QUALITY, optimize=True)
    return out.getvalue()


def _after(step: int, period: int) -> int:
    return step // period * period + period


def thinned(items: Iterable[Item], period: int) -> tuple[Item, ...]:
    """The first item of each period."""
    kept: list[Item] = []
    for item in items:
        if not kept or item.step >= _after(kept[-1].step, period):
            kept.append(item)
    return tuple(kept)


def _notes(sensed: Sensed, sensors: Iterable[MountedSensor], period: int, most_mb: float) -> Iterable[tuple[str, str]]:
    why = f", so that they fit into {most_mb:g} MB" if period > PERIODS_STEPS[0] else ""
    for sensor in sensors:
        shots = sensed.pictures.get(sensor.name)
        if shots is None:
            kept = np.mean([len(sweep.counts) for sweep in sensed.sweeps] or [0])
            measured = np.mean([sweep.measured for sweep in sensed.sweeps] or [0])
            points = f"{kept:,.0f} of {measured:,.0f} points, one in {CUBE_M:g} m"
            yield shown_text(sensor.name), f"a sweep every {period * STEP_S:g} s{why}, {points}"
        else:
            yield (
                shown_text(sensor.name),
                f"a picture every {period * STEP_S:g} s{why}, at most {_WIDTH_PX} pixels wide",
            )


def add_sensed(file: ColumnFile, sensed: Sensed) -> dict[str, Any]:
    """Adds the columns ``sweep.*`` and ``pictures.*``; what the head says of them, nothing without any."""
    if not sensed.sweeps and not any(sensed.pictures.values()):
        return {}
    _add_points(file, sensed.sweeps)
    pictures = []
    for place, (name, shots) in enumerate(sensed.pictures.items()):
        file.add_bytes(f"pictures.{place}", b"".join(shot.jpeg for shot in shots))
        pictures.append({"name": name, "shots": [[shot.step, len(shot.jpeg)] for shot in shots]})
    sweeps = [[sweep.step, len(sweep.counts), *sweep.origin_m] for sweep in sensed.sweeps]
    return {"sensed": {"sweeps": sweeps, "pictures": pictures}}


def _add_points(file: ColumnFile, sweeps: Sequence[Sweep]) -> None:
    counts = np.concatenate([sweep.counts for sweep in sweeps]) if sweeps else np.empty((0, 3))
    for axis, values in zip("xyz", counts.T, strict=True):
        file.add(f"sweep.{axis}", values * UNIT_M, UNIT_M)
