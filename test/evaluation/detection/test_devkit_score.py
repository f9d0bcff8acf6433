"""True-positive errors and the score of nuScenes, of boxes that are wrong in one thing each."""

from dataclasses import replace

import numpy as np
import pytest
from detection_boxes import made_boxes

from siren_ros.evaluation.detection.boxes import FoundBoxes, TruthBoxes
from siren_ros.evaluation.detection.devkit_score import DISTANCES_M, DevkitScore, devkit_score

X_M = [0.0, 10.0, 20.0]
TURNED_RAD = 2.0


def exact() -> tuple[TruthBoxes, FoundBoxes]:
    """Three boxes, all of them found where they are; they point to 2 rad."""
    truth, found = made_boxes(X_M, X_M, [0.9, 0.8, 0.7])
    return replace(truth, yaw_rad=np.full(3, TURNED_RAD)), replace(found, yaw_rad=np.full(3, TURNED_RAD))


def assert_errors(score: DevkitScore, **expected: float) -> None:
    """All other errors are none; the score is nuScenes' sum of five times the mAP and what is left of the errors."""
    errors = {"ATE": 0.0, "ASE": 0.0, "AOE": 0.0, "AVE": 0.0, "AAE": 0.0, **expected}
    assert dict(score.errors) == pytest.approx(errors, abs=1e-6)
    left = sum(1.0 - min(1.0, value) for value in errors.values())
    assert score.nds == pytest.approx((5.0 * score.mean_average_precision + left) / 10.0)


def test_places() -> None:
    """0.3 m east and 0.4 m south, whatever the height."""
    truth, found = exact()
    assert_errors(devkit_score(truth, replace(found, centre_m=found.centre_m + np.array([0.3, -0.4, 7.0]))), ATE=0.5)


def test_sizes() -> None:
    """4.5 m by 1.9 m by 1.6 m; the found ones are 0.9 m longer, so that 4.5/5.4 of both are common."""
    truth, found = exact()
    assert_errors(
        devkit_score(truth, replace(found, size_m=found.size_m + np.array([0.9, 0.0, 0.0]))), ASE=1.0 - 4.5 / 5.4
    )


@pytest.mark.parametrize("off_rad", [0.4, -0.7, 2.9])
def test_headings(off_rad: float) -> None:
    truth, found = exact()
    assert_errors(devkit_score(truth, replace(found, yaw_rad=found.yaw_rad + off_rad)), AOE=abs(off_rad))


def test_velocities() -> None:
    truth, found = exact()
    assert_errors(devkit_score(truth, replace(found, velocity_mps=found.velocity_mps + np.array([0.6, -0.8]))), AVE=1.0)


def test_attributes() -> None:
    """They move. Of a detection without an attribute nuScenes says nothing is right."""
    truth, found = exact()
    assert_errors(devkit_score(truth, replace(found, attribute=np.full(3, 2, dtype=np.uint8))), AAE=1.0)


def test_each_distance_has_its_precision_and_all_their_mean() -> None:
    """0.7 m off: no match within half a metre."""
    truth, found = exact()
    score = devkit_score(truth, replace(found, centre_m=found.centre_m + np.array([0.7, 0.0, 0.0])))
    assert score.average_precision == pytest.approx({0.5: 0.0, 1.0: 1.0, 2.0: 1.0, 4.0: 1.0})
    assert score.mean_average_precision == pytest.approx(0.75)
    assert score.precision.shape == (len(DISTANCES_M), 101)
    assert score.precision[0].tolist() == [0.0] * 101
    assert score.precision[1].tolist() == [1.0] * 101
    assert (score.labels, score.detections) == (3, 3)
