"""Detections survive their way through a message and its bytes."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from siren_ros.interfaces.detections import DetectedBoxes, from_detections, to_detections


@pytest.mark.parametrize("count", [0, 3])
def test_detections_come_back(round_trip: Callable[[object], Any], count: int) -> None:
    random = np.random.default_rng(2)
    boxes = DetectedBoxes(
        step=40,
        frame_id="lidar",
        class_names=("car", "ambulance", "police")[:count],
        score=random.uniform(size=count),
        centre_m=random.normal(size=(count, 3)),
        size_m=random.uniform(1.0, 5.0, (count, 3)),
        yaw_rad=random.uniform(-3.0, 3.0, count),
    )
    found = from_detections(round_trip(to_detections(boxes)))
    assert (found.step, found.frame_id, found.class_names) == (40, "lidar", boxes.class_names)
    for name in ("score", "centre_m", "size_m", "yaw_rad"):
        assert getattr(found, name) == pytest.approx(getattr(boxes, name))
