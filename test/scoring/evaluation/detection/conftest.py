"""Frames of a recorded episode with sensors, which the tests of the detection task share."""

from pathlib import Path

import pytest
from recorded_episode import sensed_recording

from siren_ros.data.episode_source import Need, in_dataset_order, survey_bag
from siren_ros.scoring.evaluation.detection.frames import Frames, frames_of, read_frames


@pytest.fixture(scope="session")
def sensed_bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two seconds with LiDAR and cameras, watched by the detector that ships."""
    return sensed_recording(tmp_path_factory)


@pytest.fixture(scope="session")
def frames(sensed_bag: Path, tmp_path_factory: pytest.TempPathFactory) -> Frames:
    survey = survey_bag(sensed_bag, "detection", (Need.LIDAR,), tmp_path_factory.mktemp("scratch"))
    return frames_of([read_frames(*one) for one in in_dataset_order([survey])])
