"""Fixtures of the risk task."""

from pathlib import Path

import pytest
from evaluation.made_video_sets import draw_films, small_video_set

from siren_ros.scoring.evaluation.risk.video_set import VideoSet, write_set


@pytest.fixture
def small_set(tmp_path: Path) -> VideoSet:
    """Three normal videos, two near-misses and one collision, of two templates."""
    return small_video_set(tmp_path)


@pytest.fixture
def drawn(small_set: VideoSet, tmp_path: Path) -> VideoSet:
    """The same set as a folder with its files and videos."""
    (tmp_path / "videos").mkdir()
    write_set(small_set)
    draw_films(tmp_path)
    return small_set
