"""Points on a vehicle stay on it, whatever the variant."""

import numpy as np
import pytest

from siren_ros.training.detection.augmentation import turned, varied
from siren_ros.training.detection.frame_store import TrainingFrame

BOX = np.array([[10.0, 4.0, -0.5, 4.0, 2.0, 1.5, 0.6, 5.0, 1.0, 0.0, 9.0]], dtype=np.float32)


def _frame() -> TrainingFrame:
    """One vehicle with a return at its front left lower corner, now and half a second ago."""
    ahead, left = np.array([np.cos(0.6), np.sin(0.6)]), np.array([-np.sin(0.6), np.cos(0.6)])
    corner = BOX[0, :2] + 2.0 * ahead + 1.0 * left
    rows = [(*corner, -1.25, 0.3, 0.0), (*(corner - 0.5 * BOX[0, 7:9]), -1.25, 0.3, 0.5)]
    return TrainingFrame(np.array(rows, dtype=np.float32), BOX.copy())


def _in_box(frame: TrainingFrame) -> np.ndarray:
    """The newest point along, across and above the middle of the box, in halves of its size."""
    box, point = frame.boxes[0], frame.points[0]
    away, yaw = point[:2] - box[:2], box[6]
    along, across = np.cos(yaw) * away[0] + np.sin(yaw) * away[1], np.cos(yaw) * away[1] - np.sin(yaw) * away[0]
    return np.array([along, across, point[2] - box[2]]) / (0.5 * box[3:6])


@pytest.mark.parametrize("angle_rad", [0.0, 1.1, -2.8])
@pytest.mark.parametrize(("mirrored", "side"), [(False, 1.0), (True, -1.0)])
def test_a_corner_stays_the_corner(angle_rad: float, mirrored: bool, side: float) -> None:
    frame = turned(_frame(), angle_rad, mirrored=mirrored, scale=1.04)
    assert _in_box(frame) == pytest.approx([1.0, side, -1.0], abs=1e-5)
    velocity = (frame.points[0, :2] - frame.points[1, :2]) / 0.5
    assert velocity == pytest.approx(frame.boxes[0, 7:9], abs=1e-4)
    assert np.hypot(*frame.boxes[0, 7:9]) == pytest.approx(1.04 * np.hypot(5.0, 1.0), rel=1e-5)


def test_variants_differ_and_leave_the_frame_alone() -> None:
    frame, random = _frame(), np.random.default_rng(3)
    one, other = varied(frame, random), varied(frame, random)
    assert abs(_in_box(one)) == pytest.approx([1.0, 1.0, 1.0], abs=1e-4)
    assert not np.allclose(one.points, other.points)
    assert np.array_equal(frame.boxes, BOX)
