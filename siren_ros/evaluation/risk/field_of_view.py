"""Who is in the field of view of a vehicle's camera, from poses alone."""

import numpy as np

from siren_ros.evaluation.surrogate_safety.encounters import Encounters
from siren_ros.numerics.arrays import Flags
from siren_ros.numerics.geometry import footprint_corners
from siren_ros.sensors.suite.mount import Mount


def in_view(encounters: Encounters, mount: Mount, horizontal_fov_rad: float, range_m: float) -> Flags:
    """Whether a part of each pair's other vehicle lies within the view of a camera on the subject, shape ``(N,)``.

    A vehicle is in view where a corner of its footprint lies within the horizontal field of view and within the range.
    What stands between is not considered: the pictures' instance masks tell who was really seen.

    Args:
        encounters: The subject that carries the camera, with the others.
        mount: Of the camera, in the subject's ``base_link``.
        horizontal_fov_rad: Full angle.
        range_m: From the camera.
    """
    subject, other = encounters.subject, encounters.other
    corners = footprint_corners(other.x_m, other.y_m, other.yaw_rad, *encounters.other_size_m.T)
    cos, sin = np.cos(subject.yaw_rad), np.sin(subject.yaw_rad)
    eye_x = subject.x_m + cos * mount.x_m - sin * mount.y_m
    eye_y = subject.y_m + sin * mount.x_m + cos * mount.y_m
    dx, dy = corners[..., 0] - eye_x[:, None], corners[..., 1] - eye_y[:, None]
    look = subject.yaw_rad + mount.yaw_rad
    ahead = dx * np.cos(look)[:, None] + dy * np.sin(look)[:, None]
    aside = dy * np.cos(look)[:, None] - dx * np.sin(look)[:, None]
    within = np.abs(np.arctan2(aside, ahead)) <= 0.5 * horizontal_fov_rad
    return np.asarray((within & (np.hypot(ahead, aside) <= range_m)).any(axis=1))
