"""The LiDAR's returns of a frame, seen from above."""

from pathlib import Path
from typing import Final

import numpy as np

from siren_ros.datasets.sources.episode_source import open_source
from siren_ros.datasets.sources.lidar_frames import lidar_of
from siren_ros.evaluation.detection.protocol.frames import EpisodeFrames
from siren_ros.interfaces.point_cloud import from_point_cloud
from siren_ros.numerics.arrays import Floats

_LOW_M: Final = 0.3
_HIGH_M: Final = 3.0
"""Heights above the ground at the sensor between which a return can be from a vehicle."""


def returns_from_above(episode: EpisodeFrames, row: int) -> Floats:
    """Returns of a frame at the height of vehicles, x and y in the ``map`` frame, shape ``(N, 2)``.

    Raises:
        BagError: The bag is damaged.
    """
    step = int(episode.step[row])
    map_from_lidar = episode.map_from_lidar[row]
    ground_m = (map_from_lidar @ np.linalg.inv(episode.base_from_lidar))[2, 3]
    with open_source(Path(episode.bag)) as source:
        topic = lidar_of(source).topic
        for found, held in source.messages_by_step({topic}):
            if found == step:
                points = from_point_cloud(held[topic].read())
                xyz = np.stack([points[name].astype(np.float64) for name in ("x", "y", "z")], axis=-1)
                xyz = xyz @ map_from_lidar[:3, :3].T + map_from_lidar[:3, 3]
                height = xyz[:, 2] - ground_m
                return np.asarray(xyz[(height > _LOW_M) & (height < _HIGH_M), :2])
    return np.zeros((0, 2))
