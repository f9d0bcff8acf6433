"""Plane geometry of poses and vehicle footprints."""

import numpy as np
import numpy.typing as npt

from siren_ros.numerics.arrays import Floats


def wrap_angle(angle_rad: npt.ArrayLike) -> Floats:
    """The same direction within (−π, π]."""
    wrapped = np.mod(np.asarray(angle_rad, dtype=np.float64) + np.pi, 2.0 * np.pi) - np.pi
    return np.where(wrapped == -np.pi, np.pi, wrapped)


def footprint_corners(x_m: Floats, y_m: Floats, yaw_rad: Floats, length_m: Floats, width_m: Floats) -> Floats:
    """Corners of oriented boxes, shape ``(N, 4, 2)``: front left, rear left, rear right, front right."""
    along = np.stack((np.cos(yaw_rad), np.sin(yaw_rad)), axis=-1)
    left = np.stack((-along[..., 1], along[..., 0]), axis=-1)
    half_along = along * (np.asarray(length_m) / 2.0)[..., None]
    half_left = left * (np.asarray(width_m) / 2.0)[..., None]
    centre = np.stack((x_m, y_m), axis=-1)
    corners = (half_along + half_left, half_left - half_along, -half_along - half_left, half_along - half_left)
    return np.stack([centre + corner for corner in corners], axis=-2)


def separation_m(corners_a: Floats, corners_b: Floats) -> Floats:
    """Largest gap along a separating axis between pairs of boxes, shape ``(N,)``; ≤ 0 where they overlap.

    Both inputs have shape ``(N, 4, 2)`` as ``footprint_corners`` gives them. For overlapping boxes the
    value is minus the penetration depth (separating axis theorem); for separate boxes it is a lower
    bound of their distance.
    """
    sides = [corners[:, (1, 3)] - corners[:, :1] for corners in (corners_a, corners_b)]
    axes = np.concatenate(sides, axis=1)
    axes = (axes / np.hypot(axes[..., 0], axes[..., 1])[..., None]).transpose(0, 2, 1)
    a, b = corners_a @ axes, corners_b @ axes
    gaps = np.maximum(b.min(axis=1) - a.max(axis=1), a.min(axis=1) - b.max(axis=1))
    return np.asarray(gaps.max(axis=1))


def overlapping_pairs(
    x_m: Floats, y_m: Floats, yaw_rad: Floats, length_m: Floats, width_m: Floats
) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp], Floats]:
    """Which of ``N`` oriented boxes overlap: rows of both, the smaller first, and the depth of each pair in metres."""
    radius = 0.5 * np.hypot(length_m, width_m)
    apart = np.hypot(x_m[:, None] - x_m, y_m[:, None] - y_m)
    first, second = np.nonzero(np.triu(apart < radius[:, None] + radius, 1))
    corners = footprint_corners(x_m, y_m, yaw_rad, length_m, width_m)
    gap = separation_m(corners[first], corners[second])
    inside = gap < 0.0
    return first[inside], second[inside], -gap[inside]


def rotate(points: Floats, yaw_rad: float) -> Floats:
    """Points (shape ``(..., 2)``) turned counter-clockwise about the origin."""
    cos, sin = np.cos(yaw_rad), np.sin(yaw_rad)
    return points @ np.array([[cos, sin], [-sin, cos]])
