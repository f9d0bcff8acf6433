"""ScenarioNet as MetaDrive reads and replays it."""

from pathlib import Path
from typing import Any

import pytest
from reader_environments import read_with

from siren_ros.cli.main import main
from siren_ros.datasets.sources.episode_source import open_source
from siren_ros.datasets.sources.tracks import tracks_of


@pytest.fixture(scope="module")
def read(tracked_bag: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    out = tmp_path_factory.mktemp("scenarionet") / "out"
    assert main(["export", "scenarionet", str(tracked_bag), "--out", str(out)]) == 0
    found: dict[str, Any] = read_with("metadrive", "read_scenarionet.py", out / "train")
    return found


def test_metadrives_sanity_check_passes(read: dict[str, Any], tracked_bag: Path) -> None:
    with open_source(tracked_bag) as source:
        tracks = [track for track in tracks_of(source.record()) if len(track) > 1]
    assert (read["scenarios"], read["length"]) == (1, 140)
    assert read["tracks"] == len(tracks)
    assert read["features"] > 200
    assert read["lights"] > 10


def test_metadrive_replays_the_episode(read: dict[str, Any]) -> None:
    assert read["steps"] > 100
    assert read["travelled"] == pytest.approx(read["recorded"], rel=0.02)
    assert read["others"] > 5
