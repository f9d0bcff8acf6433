"""Measures how much of each labelled vehicle the LiDAR sees, counts points in boxes, and projects boxes to pictures."""

from typing import Final

import numpy as np
import numpy.typing as npt

from siren_ros.base.numerics.arrays import Floats, Ids, Matrix, Rows
from siren_ros.base.numerics.geometry import wrap_angle
from siren_ros.simulation.world.carrier import CameraIntrinsics, GroundTruth

_CLEARANCE_M: Final = 0.2
"""A return that is nearer than a box's nearest corner by more than this is on another object in front of it."""
_NEAR_M: Final = 0.1
"""Geometry nearer to the camera than this is clipped before projection."""
_SIGNS: Final = np.array(
    [[x, y, z] for z in (-0.5, 0.5) for x, y in ((0.5, 0.5), (0.5, -0.5), (-0.5, -0.5), (-0.5, 0.5))]
)
BOX_EDGES: Final = np.array(
    [(0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7)]
)
"""Pairs of corners of ``box_corners`` that an edge joins."""


def box_corners(truth: GroundTruth) -> Floats:
    """Corners of all boxes in the frame of the truth, shape ``(N, 8, 3)``; the four at the bottom first."""
    centre = np.stack((truth.x_m, truth.y_m, truth.z_m), axis=-1)
    size = np.stack((truth.length_m, truth.width_m, truth.height_m), axis=-1)
    return upright_corners(centre, size, truth.yaw_rad)


def upright_corners(centre_m: Floats, size_m: Floats, yaw_rad: Floats) -> Floats:
    """Corners of upright boxes, shape ``(N, 8, 3)``; the four at the bottom first.

    Centres of the volumes and sizes (length, width, height) have the shape ``(N, 3)``; yaw is counter-clockwise from x.
    """
    local = _SIGNS * size_m[:, None]
    cos, sin = np.cos(yaw_rad)[:, None], np.sin(yaw_rad)[:, None]
    x = local[..., 0] * cos - local[..., 1] * sin
    y = local[..., 0] * sin + local[..., 1] * cos
    return np.stack((x, y, local[..., 2]), axis=-1) + centre_m[:, None]


def lidar_visibility(points: npt.NDArray[np.void], truth: GroundTruth, rows: Rows) -> Floats:
    """Share of each box that the LiDAR sees: own returns / (own returns + returns in front of it).

    Directions are those between the azimuths and elevations of the box's corners. 0 where nothing of it was hit. The
    sweep is in the frame of the truth, with the field ``instance``; the answer has the shape of ``rows``, some labels.
    """
    x, y, z = points["x"], points["y"], points["z"]
    azimuth, flat = np.arctan2(y, x), np.hypot(x, y)
    elevation, distance = np.arctan2(z, flat), np.hypot(flat, z)
    corners = box_corners(truth)[rows]
    flat_corner = np.hypot(corners[..., 0], corners[..., 1])
    middle = np.arctan2(truth.y_m[rows], truth.x_m[rows])
    side = wrap_angle(np.arctan2(corners[..., 1], corners[..., 0]) - middle[:, None])
    height = np.arctan2(corners[..., 2], flat_corner)
    nearest = np.hypot(flat_corner, corners[..., 2]).min(axis=1)
    seen = np.zeros(len(rows))
    for number, row in enumerate(rows.tolist()):
        returns = int(truth.lidar_points[row])
        if returns == 0:
            continue
        before = (distance < nearest[number] - _CLEARANCE_M) & (elevation >= height[number].min())
        candidates = np.flatnonzero(before & (elevation <= height[number].max()))
        turned = wrap_angle(azimuth[candidates].astype(np.float64) - middle[number])
        hidden = int(((turned >= side[number].min()) & (turned <= side[number].max())).sum())
        seen[number] = returns / (returns + hidden)
    return seen


def points_in_boxes(points: npt.NDArray[np.void], truth: GroundTruth) -> Ids:
    """Count the points in each box, on any object, shape ``(N,)``: nuScenes' ``num_lidar_pts``.

    That is not ``lidar_points``, which counts the returns of the vehicle. Half of the returns of the ground under a
    vehicle lie in its box, because the box stands on the ground and ranges are noisy; mirrors stick out of it.
    """
    xyz = np.stack((points["x"], points["y"], points["z"]), axis=-1).astype(np.float64)
    half = np.stack((truth.length_m, truth.width_m, truth.height_m), axis=-1) / 2.0
    counts = np.zeros(len(truth), dtype=np.uint32)
    for row, (x, y, z) in enumerate(zip(truth.x_m, truth.y_m, truth.z_m, strict=True)):
        near = xyz[np.hypot(xyz[:, 0] - x, xyz[:, 1] - y) <= np.hypot(*half[row, :2]) + _CLEARANCE_M] - (x, y, z)
        cos, sin = np.cos(truth.yaw_rad[row]), np.sin(truth.yaw_rad[row])
        ahead, left = near[:, 0] * cos + near[:, 1] * sin, near[:, 1] * cos - near[:, 0] * sin
        inside = (np.abs(ahead) <= half[row, 0]) & (np.abs(left) <= half[row, 1]) & (np.abs(near[:, 2]) <= half[row, 2])
        counts[row] = np.count_nonzero(inside)
    return counts


def image_boxes(corners: Floats, camera_from_frame: Matrix, camera: CameraIntrinsics) -> tuple[Floats, Floats]:
    """Project boxes, given by corners as of ``box_corners``, to a picture; the matrix leads to the optical frame.

    Returns left, top, right, bottom within the picture in pixels, shape ``(N, 4)``, all 0 for a box outside; and the
    share of the box's whole rectangle that lies outside, shape ``(N,)``, 1 for a box outside.
    """
    seen = corners @ camera_from_frame[:3, :3].T + camera_from_frame[:3, 3]
    starts, ends = seen[:, BOX_EDGES[:, 0]], seen[:, BOX_EDGES[:, 1]]
    # Edges are clipped at the near plane, because points behind the camera would be projected to the wrong side.
    depth_change = ends[..., 2] - starts[..., 2]
    share = (_NEAR_M - starts[..., 2]) / np.where(depth_change == 0.0, 1.0, depth_change)
    cut = starts + np.clip(share, 0.0, 1.0)[..., None] * (ends - starts)
    crossing = (starts[..., 2] < _NEAR_M) != (ends[..., 2] < _NEAR_M)
    points = np.concatenate((seen, cut), axis=1)
    there = np.concatenate((seen[..., 2] >= _NEAR_M, crossing), axis=1)
    depth = np.maximum(points[..., 2], _NEAR_M)
    u = points[..., 0] / depth * camera.focal_x_px + camera.centre_x_px
    v = points[..., 1] / depth * camera.focal_y_px + camera.centre_y_px
    whole = np.stack(
        (
            np.where(there, u, np.inf).min(axis=1),
            np.where(there, v, np.inf).min(axis=1),
            np.where(there, u, -np.inf).max(axis=1),
            np.where(there, v, -np.inf).max(axis=1),
        ),
        axis=-1,
    )
    limits = np.array([camera.width - 1.0, camera.height - 1.0] * 2)
    inside = np.clip(whole, 0.0, limits)
    area = (inside[:, 2] - inside[:, 0]) * (inside[:, 3] - inside[:, 1])
    visible = there.any(axis=1) & (area > 1.0)
    with np.errstate(invalid="ignore"):
        total = (whole[:, 2] - whole[:, 0]) * (whole[:, 3] - whole[:, 1])
    outside = np.where(visible, 1.0 - area / np.where(visible, total, 1.0), 1.0)
    return np.where(visible[:, None], inside, 0.0), np.clip(outside, 0.0, 1.0)
