"""Boxes in a picture: where the formula of a pinhole puts them."""

import numpy as np
import pytest
from matplotlib.collections import LineCollection
from matplotlib.colors import to_hex
from matplotlib.figure import Figure

from siren_ros.evaluation.detection.protocol.boxes import Boxes
from siren_ros.evaluation.detection.reports.camera_view import (
    FrontPicture,
    draw_in_picture,
    edges_in_picture,
)
from siren_ros.interfaces.images import CameraIntrinsics

CAMERA_FROM_MAP = np.array([[0, -1.0, 0, 0], [0, 0, -1.0, 1.0], [1.0, 0, 0, 0], [0, 0, 0, 1.0]])
"""A metre above the ground, looking along x."""
PICTURE = FrontPicture(
    np.zeros((600, 800, 3), dtype=np.uint8), CameraIntrinsics(800, 600, 400.0, 400.0, 400.0, 300.0), CAMERA_FROM_MAP
)


def _box(x_m: float, y_m: float, yaw_rad: float) -> Boxes:
    return Boxes(
        frame=np.zeros(1, dtype=np.intp),
        centre_m=np.array([[x_m, y_m, 1.0]]),
        size_m=np.array([[4.0, 2.0, 1.0]]),
        yaw_rad=np.array([yaw_rad]),
        velocity_mps=np.zeros((1, 2)),
        attribute=np.zeros(1, dtype=np.uint8),
    )


@pytest.mark.parametrize(("yaw_rad", "half_length_m", "half_width_m"), [(0.0, 2.0, 1.0), (np.pi / 2.0, 1.0, 2.0)])
def test_corners_are_where_a_pinhole_sees_them(yaw_rad: float, half_length_m: float, half_width_m: float) -> None:
    edges = edges_in_picture(PICTURE, _box(12.0, 3.0, yaw_rad))
    assert edges.shape == (12, 2, 2)
    near, far = 12.0 - half_length_m, 12.0 + half_length_m
    columns = [400.0 - 400.0 * (3.0 + side * half_width_m) / away for away in (near, far) for side in (-1, 1)]
    assert np.unique(edges[..., 0].round(6)) == pytest.approx(sorted(columns))
    assert np.unique(edges[..., 1].round(6)) == pytest.approx(
        sorted(300.0 + sign * 400.0 * 0.5 / away for away in (near, far) for sign in (-1, 1))
    )


def test_what_is_behind_the_camera_is_not_drawn() -> None:
    assert edges_in_picture(PICTURE, _box(-12.0, 0.0, 0.0)).shape == (0, 2, 2)
    assert edges_in_picture(PICTURE, _box(1.0, 0.0, 0.0)).shape == (4, 2, 2)


def test_edges_lie_over_the_picture_in_the_colours_of_their_groups() -> None:
    axes = Figure().add_subplot()
    boxes = {"one": _box(12.0, 3.0, 0.0), "other": _box(20.0, -3.0, 0.5)}
    draw_in_picture(axes, PICTURE, boxes, {"one": "#112233", "other": "#445566"})
    (image,) = axes.images
    assert image.get_array().shape == (600, 800, 3)
    # Rows are counted from the top.
    assert (axes.get_xlim(), axes.get_ylim()) == ((0.0, 800.0), (600.0, 0.0))
    lines = [one for one in axes.collections if isinstance(one, LineCollection)]
    for found, name, colour in zip(lines, boxes, ("#112233", "#445566"), strict=True):
        assert np.array(found.get_segments()) == pytest.approx(edges_in_picture(PICTURE, boxes[name]))
        assert to_hex(found.get_colors()[0]) == colour
    assert not axes.axison


@pytest.mark.parametrize(("rear_m", "edges"), [(0.51, 12), (0.49, 4)])
def test_edges_within_half_a_metre_of_the_lens_are_left_out(rear_m: float, edges: int) -> None:
    """Where the rear is too near, its four edges go, and the four that lead to it."""
    assert len(edges_in_picture(PICTURE, _box(rear_m + 2.0, 0.0, 0.0))) == edges
