"""Frames with made vehicles, for the tests of the detector's training."""

import numpy as np

from siren_ros.lab.training.detection.samples import BagFrames, joined_frames
from siren_ros.scoring.evaluation.detection.detectors.pillars import PillarGrid

SMALL_GRID = PillarGrid(half_width_m=16.0, cells=64, points=6, pillars=500)


def made_episode(seed: int, frames: int = 6) -> BagFrames:
    """Each frame has one vehicle of 4.4 m on flat ground, with returns on all its sides."""
    random = np.random.default_rng(seed)
    points, boxes = [], []
    for _ in range(frames):
        place, yaw = random.uniform(-10.0, 10.0, 2), float(random.uniform(-3.0, 3.0))
        along, across, up = random.uniform(-1.0, 1.0, (3, 150)) * np.array([[2.2], [0.9], [0.7]])
        x = place[0] + np.cos(yaw) * along - np.sin(yaw) * across
        y = place[1] + np.sin(yaw) * along + np.cos(yaw) * across
        rows = np.stack((x, y, up - 1.0, np.full(150, 0.4), np.zeros(150)), axis=-1)
        ground = np.column_stack((random.uniform(-16.0, 16.0, (400, 2)), np.tile([-1.9, 0.1, 0.05], (400, 1))))
        points.append(np.vstack((rows, ground)).astype(np.float32))
        boxes.append(np.array([[*place, -1.0, 4.4, 1.8, 1.4, yaw, 0.0, 0.0, 0.0, 150.0]], dtype=np.float32))
    about = {"template": "S2", "level": "L2", "seed": seed, "map": "made", "key": f"made S2 {seed}"}
    return joined_frames(about, points, boxes)
