"""The labels of a recorded episode as detections."""

from pathlib import Path

import pytest

from siren_ros.evaluation.detection.metrics.devkit_score import devkit_score
from siren_ros.evaluation.detection.protocol.frames import Frames
from siren_ros.evaluation.detection.scoring import VEHICLE_NAMES, counted_boxes
from siren_ros.evaluation.detection.self_test import self_test_sets


def test_labels_score_fully_through_every_format(frames: Frames, tmp_path: Path) -> None:
    sets = self_test_sets(frames, tmp_path)
    assert [one.format for one in sets] == [
        "nuScenes results",
        "OpenPCDet results",
        "OpenPCDet results",
        "KITTI results",
        "recorded topic",
    ]
    for one in sets:
        score = devkit_score(*counted_boxes(frames, one, VEHICLE_NAMES))
        assert score.labels == score.detections > 10
        assert score.mean_average_precision == pytest.approx(1.0)
        errors = dict(score.errors)
        if not one.has_velocity:
            assert (errors.pop("AVE"), errors.pop("AAE")) == (1.0, 1.0)
        assert max(errors.values()) == pytest.approx(0.0, abs=1e-5)
