"""Samples of 3-D detection: ten LiDAR sweeps in the frame of the last one, and the boxes of the vehicles."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Final

import numpy as np

from siren_ros.data.record.bag_survey import episode_name
from siren_ros.lab.training.detection.samples import BOX_COLUMNS, frames_of_bag
from siren_ros.lab.training.packed.parquet_samples import Column, Sample
from siren_ros.scoring.evaluation.detection.boxes import CLASS_NAMES
from siren_ros.scoring.evaluation.detection.detectors.pillars import COLUMNS as POINT_COLUMNS
from siren_ros.scoring.evaluation.detection.detectors.pillars import PillarGrid

COLUMNS: Final[Mapping[str, Column]] = {
    "episode": Column(str, (), "id of the episode"),
    "template": Column(str, (), "template of the episode"),
    "frame": Column(np.int32, (), "number of the frame in its episode, 2 Hz"),
    "points": Column(
        np.float32,
        (-1, len(POINT_COLUMNS)),
        "points of ten sweeps in the frame of the last one, x forward, z = 0 where the ground of a LiDAR at 1.93 m "
        "would have z = -1.93; crowded pillars of 0.256 m are thinned",
        POINT_COLUMNS,
    ),
    "boxes": Column(
        np.float32,
        (-1, len(BOX_COLUMNS)),
        f"vehicles: centre, size, yaw, velocity, class ({', '.join(CLASS_NAMES)}), LiDAR points; metres, radians, m/s",
        BOX_COLUMNS,
    ),
}


def detection_samples(bag: Path) -> Iterator[Sample]:
    """Samples of an episode, two per second.

    Raises:
        BagError: The bag is damaged or has no LiDAR.
    """
    frames = frames_of_bag(bag, PillarGrid())
    about = frames.about
    name = episode_name(about["template"], about["level"], about["seed"], about["map"])
    for number in range(len(frames)):
        frame = frames.frame(number)
        yield {
            "episode": name,
            "template": about["template"],
            "frame": number,
            "points": frame.points,
            "boxes": frame.boxes,
        }
