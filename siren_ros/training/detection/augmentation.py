"""Frames as they could have been elsewhere: turned, mirrored, scaled, so that no map is learned by heart."""

from typing import Final

import numpy as np

from siren_ros.numerics.arrays import Floats32
from siren_ros.training.detection.frame_store import TrainingFrame

_SCALE: Final = 0.05


def turned(frame: TrainingFrame, angle_rad: float, *, mirrored: bool, scale: float) -> TrainingFrame:
    """The frame mirrored about the x axis, then turned counter-clockwise and scaled, with its labels."""
    points, boxes = frame.points.copy(), frame.boxes.copy()
    if mirrored:
        points[:, 1] *= -1.0
        boxes[:, [1, 6, 8]] *= -1.0
    points[:, :2], boxes[:, :2], boxes[:, 7:9] = (
        _rotated(part, angle_rad) for part in (points[:, :2], boxes[:, :2], boxes[:, 7:9])
    )
    boxes[:, 6] += np.float32(angle_rad)
    points[:, :3] *= np.float32(scale)
    boxes[:, [0, 1, 2, 3, 4, 5, 7, 8]] *= np.float32(scale)
    return TrainingFrame(points, boxes)


def varied(frame: TrainingFrame, random: np.random.Generator) -> TrainingFrame:
    """A random variant: any direction, either hand, 5 % larger or smaller, any strength of the returns."""
    angle = float(random.uniform(-np.pi, np.pi))
    scale = float(random.uniform(1.0 - _SCALE, 1.0 + _SCALE))
    found = turned(frame, angle, mirrored=bool(random.random() < 0.5), scale=scale)
    found.points[:, 2] += np.float32(lift := random.uniform(-0.2, 0.2))
    found.boxes[:, 2] += np.float32(lift)
    return found


def _rotated(xy: Floats32, angle_rad: float) -> Floats32:
    cos, sin = np.float32(np.cos(angle_rad)), np.float32(np.sin(angle_rad))
    return np.stack((cos * xy[:, 0] - sin * xy[:, 1], sin * xy[:, 0] + cos * xy[:, 1]), axis=-1)
