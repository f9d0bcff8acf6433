"""What the LiDAR sees of a box, and where boxes stand in a picture, on formulas."""

from dataclasses import replace

import numpy as np
import pytest
from synthetic_episode import SyntheticEpisode

from siren_ros.data.datasets.visibility import box_corners, image_boxes, lidar_visibility, points_in_boxes
from siren_ros.sensing.lidar.lidar import LIDAR_POINT_DTYPE
from siren_ros.simulation.world.carrier import CameraIntrinsics, GroundTruth

CAMERA = CameraIntrinsics(801, 601, 400.0, 400.0, 400.0, 300.0)
CAMERA_FROM_FRAME = np.array([[0.0, -1, 0, 0], [0, 0, -1, 0], [1, 0, 0, 0], [0, 0, 0, 1]])


def box_at(x_m: float, y_m: float, points: int = 10, yaw_rad: float = 0.0) -> GroundTruth:
    """One box, 4 × 2 × 2 m, its centre at the sensor's height."""
    truth = SyntheticEpisode().ground_truth(0)
    first_box = {
        name: values[:1].copy() if isinstance(values, np.ndarray) else values for name, values in vars(truth).items()
    }
    box = {"x_m": x_m, "y_m": y_m, "z_m": 0.0, "yaw_rad": yaw_rad, "length_m": 4.0, "width_m": 2.0, "height_m": 2.0}
    changed = {name: np.array([value]) for name, value in box.items()}
    return replace(truth, **{**first_box, **changed, "lidar_points": np.array([points], dtype=np.uint32)})


def points_at(*xyz: tuple[float, float, float]) -> np.ndarray:
    points = np.zeros(len(xyz), dtype=LIDAR_POINT_DTYPE)
    points["x"], points["y"], points["z"] = np.array(xyz, dtype=np.float32).reshape(-1, 3).T
    return points


def test_corners_are_those_of_a_turned_box():
    corners = box_corners(box_at(10.0, 0.0, yaw_rad=np.pi / 2))[0]
    assert corners.min(axis=0) == pytest.approx((9.0, -2.0, -1.0))
    assert corners.max(axis=0) == pytest.approx((11.0, 2.0, 1.0))
    assert corners[:4, 2] == pytest.approx(np.full(4, -1.0))


@pytest.mark.parametrize(
    ("hidden", "expected"),
    [([], 1.0), ([(4.0, 0.0, 0.0)] * 10, 0.5), ([(12.5, 0.0, 0.0)] * 10, 1.0), ([(4.0, 3.0, 0.0)] * 10, 1.0)],
)
def test_what_stands_before_a_box_hides_it(hidden, expected):
    seen = lidar_visibility(points_at(*hidden), box_at(10.0, 0.0), np.array([0]))
    assert seen == pytest.approx([expected])


def test_a_box_behind_the_sensor_is_no_other_case_and_one_without_a_point_is_not_seen():
    points = points_at(*[(-4.0, 0.0, 0.0)] * 30)
    assert lidar_visibility(points, box_at(-10.0, 0.0), np.array([0])) == pytest.approx([0.25])
    assert lidar_visibility(points_at(), box_at(10.0, 0.0, points=0), np.array([0])).tolist() == [0.0]


def test_a_box_ahead_stands_where_it_is_projected():
    boxes, outside = image_boxes(box_corners(box_at(12.0, 0.0)), CAMERA_FROM_FRAME, CAMERA)
    # Its near face is 10 m away and reaches 1 m to each side.
    assert boxes[0] == pytest.approx((360.0, 260.0, 440.0, 340.0))
    assert outside == pytest.approx([0.0])


def test_a_box_at_the_edge_is_cut_and_one_outside_is_all_zero():
    boxes, outside = image_boxes(box_corners(box_at(12.0, 10.0)), CAMERA_FROM_FRAME, CAMERA)
    assert boxes[0, 0] == 0.0
    assert 0.0 < outside[0] < 1.0
    for place in ((-10.0, 0.0), (5.0, 60.0)):
        boxes, outside = image_boxes(box_corners(box_at(*place)), CAMERA_FROM_FRAME, CAMERA)
        assert (boxes.tolist(), outside.tolist()) == ([[0.0] * 4], [1.0])


def test_a_box_that_reaches_behind_the_camera_does_not_flip():
    boxes, outside = image_boxes(box_corners(box_at(1.0, 3.0)), CAMERA_FROM_FRAME, CAMERA)
    assert boxes[0, 0] == 0.0
    assert boxes[0, 2] < 400.0
    assert 0.5 < outside[0] < 1.0


@pytest.mark.parametrize("yaw_rad", [0.0, 0.7, -2.5])
def test_what_lies_in_a_box_is_counted_whatever_it_is(yaw_rad):
    """Corners and faces belong to the box; the number of returns of the vehicle says nothing."""
    cos, sin = np.cos(yaw_rad), np.sin(yaw_rad)
    local = [(1.99, 0.99, 0.99), (-1.99, -0.99, -0.99), (0.0, 0.0, -1.0), (2.01, 0.0, 0.0), (0.0, 1.01, 0.0)]
    outside = [(0.0, 0.0, -1.01), (0.0, 0.0, 1.01), (-2.01, 0.0, 0.0), (0.0, -1.01, 0.0), (1.5, 1.5, 0.0)]
    placed = [(10.0 + x * cos - y * sin, 3.0 + x * sin + y * cos, z) for x, y, z in (*local, *outside)]
    box = box_at(10.0, 3.0, points=99, yaw_rad=yaw_rad)
    assert points_in_boxes(points_at(*placed), box).tolist() == [3]
    assert points_in_boxes(points_at(), box).tolist() == [0]
