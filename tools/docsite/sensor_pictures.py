"""Pictures of what sensors see, for README and the page of the sensors, from episodes of S1 and S2 without sensors."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt
from PIL import Image

from siren_ros.base.numerics.units import steps_from_s
from siren_ros.data.recording.bag_reader import read_episode
from siren_ros.data.recording.episode_record import EpisodeRecord
from siren_ros.scoring.pictures.sensor_views import cloud_by_height, cloud_by_instance, observe_at, sheet
from siren_ros.sensing.look import load_look
from siren_ros.sensing.suite import SensorSuite, load_suite

Picture = npt.NDArray[np.uint8]

LOOKS: Final = ("clear", "evening", "rain", "dusk", "night", "fog")
QUALITY: Final = 78
"""WebP's."""
_GAP_PX: Final = 4
_CLOUD: Final = (slice(60, 400), slice(75, 725))
"""Rows and columns of a point cloud's picture with something in them."""
_QUEUE_S: Final = 8.0
_PLATOON_S: Final = 3.0
_PASSING_S: Final = 5.0
"""Times of S1, and two of S2, at which vehicles are near the EMV."""


def tiled(pictures: Sequence[Picture], columns: int) -> Picture:
    """Pictures of one size in rows, with black gaps between them."""
    height, width = pictures[0].shape[:2]
    rows = -(-len(pictures) // columns)
    size = (rows * (height + _GAP_PX) - _GAP_PX, columns * (width + _GAP_PX) - _GAP_PX, 3)
    whole = np.zeros(size, np.uint8)
    for number, picture in enumerate(pictures):
        top, left = number // columns * (height + _GAP_PX), number % columns * (width + _GAP_PX)
        whole[top : top + height, left : left + width] = picture
    return whole


def vehicles_ahead(record: EpisodeRecord, time_s: float, number: int) -> list[int]:
    """The civilians nearest ahead of the first EMV that drive in its direction, nearest first."""
    states = record.states[steps_from_s(time_s)]
    emv = int(np.flatnonzero(states.actor_id == record.emv_ids[0])[0])
    heading = np.array([np.cos(states.yaw_rad[emv]), np.sin(states.yaw_rad[emv])])
    apart = np.stack([states.x_m - states.x_m[emv], states.y_m - states.y_m[emv]], axis=1)
    ahead, aside = apart @ heading, np.abs(apart @ np.array([-heading[1], heading[0]]))
    same_way = np.cos(states.yaw_rad - states.yaw_rad[emv]) > 0.9
    rows = np.flatnonzero(same_way & (ahead > 1.0) & (aside < 6.0))
    return [int(states.actor_id[index]) for index in rows[np.argsort(ahead[rows])][:number]]


def _camera(suite: SensorSuite, name: str) -> SensorSuite:
    """The suite with one camera and nothing else."""
    cameras = tuple(camera for camera in suite.cameras if camera.name == name)
    return replace(suite, cameras=cameras, lidars=(), others=())


def _save(picture: Picture, path: Path, width: int) -> None:
    image = Image.fromarray(picture)
    size = (width, round(image.height * width / image.width))
    image.resize(size, Image.Resampling.LANCZOS).save(path, quality=QUALITY, method=6)


def draw_sensors(queues: Path, platoon: Path, folder: Path) -> None:
    """Draws all pictures of sensors.

    Args:
        queues: A recorded episode of S1.
        platoon: A recorded episode of S2.
        folder: Where the pictures go.
    """
    folder.mkdir(parents=True, exist_ok=True)
    full, clear = load_suite("full"), load_look("clear")
    record = read_episode(queues)
    _save(sheet(observe_at(record, _QUEUE_S, full, clear)), folder / "s1_full.webp", 1000)
    record = read_episode(platoon)
    seen = observe_at(record, _PLATOON_S, load_suite("front"), clear)
    _save(seen.frames[0].rgb, folder / "s2_front.webp", 1100)
    clouds = [cloud[_CLOUD] for cloud in (cloud_by_height(seen.sweeps[0]), cloud_by_instance(seen.sweeps[0]))]
    _save(tiled(clouds, 2), folder / "lidar.webp", 1304)
    front = _camera(full, "camera_front")
    looks = [observe_at(record, _PLATOON_S, front, load_look(name)).frames[0].rgb for name in LOOKS]
    _save(tiled(looks, 3), folder / "looks.webp", 1448)
    rear = _camera(full, "camera_rear")
    night = [
        observe_at(record, _PASSING_S, rear, load_look("night"), carrier).frames[0].rgb
        for carrier in vehicles_ahead(record, _PASSING_S, 2)
    ]
    _save(tiled(night, 2), folder / "s2_night.webp", 1200)
