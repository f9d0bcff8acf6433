"""Frames as they could have been elsewhere: turned, mirrored, scaled, so that no map is learned by heart."""

from typing import Final

import numpy as np

from siren_ros.numerics.arrays import Floats32
from siren_ros.training.detection.frame_store import TrainingFrame

_SCALE: Final = 0.05
_LIFT_M: Final = 0.2
_EXTINCTION_PER_M: Final = 0.03
"""Highest of the air, a little above that of the look ``fog``; light goes through it twice."""


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
    """A random variant: any direction, either hand, 5 % larger or smaller, another height, clear or thick air."""
    angle = float(random.uniform(-np.pi, np.pi))
    scale = float(random.uniform(1.0 - _SCALE, 1.0 + _SCALE))
    found = turned(frame, angle, mirrored=bool(random.random() < 0.5), scale=scale)
    lift = np.float32(random.uniform(-_LIFT_M, _LIFT_M))
    found.points[:, 2] += lift
    found.boxes[:, 2] += lift
    extinction = np.float32(max(0.0, random.uniform(-_EXTINCTION_PER_M, _EXTINCTION_PER_M)))
    found.points[:, 3] *= np.exp(-2.0 * extinction * np.hypot(found.points[:, 0], found.points[:, 1]))
    return found


def _rotated(xy: Floats32, angle_rad: float) -> Floats32:
    cos, sin = np.float32(np.cos(angle_rad)), np.float32(np.sin(angle_rad))
    return np.stack((cos * xy[:, 0] - sin * xy[:, 1], sin * xy[:, 0] + cos * xy[:, 1]), axis=-1)
