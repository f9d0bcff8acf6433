"""Fixtures of the risk task."""

from pathlib import Path

import pytest
from evaluation.made_video_sets import small_video_set

from siren_ros.evaluation.risk.video_set import VideoSet


@pytest.fixture
def small_set(tmp_path: Path) -> VideoSet:
    """Three normal videos, two near-misses and one collision, of two templates."""
    return small_video_set(tmp_path)
