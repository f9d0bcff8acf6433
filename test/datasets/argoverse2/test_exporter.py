"""Argoverse 2 as av2 reads it."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from reader_environments import read_with

from siren_ros.cli.main import main
from siren_ros.datasets.argoverse2.exporter import scenario_id
from siren_ros.datasets.sources.episode_source import open_source
from siren_ros.datasets.sources.tracks import Track, tracks_of, whole_windows


@pytest.fixture(scope="module")
def tracks(tracked_bag: Path) -> tuple[Track, ...]:
    with open_source(tracked_bag) as source:
        return tracks_of(source.record())


@pytest.fixture(scope="module")
def dataset(tracked_bag: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("argoverse2") / "out"
    assert main(["export", "argoverse2", str(tracked_bag), "--out", str(out), "--population", "all"]) == 0
    return out


@pytest.fixture(scope="module")
def read(dataset: Path) -> dict[str, Any]:
    found: dict[str, Any] = read_with("av2", "read_argoverse2.py", dataset / "train" / "S3-L1-seed0-town-v1-f000060")
    return found


def test_there_is_a_scenario_for_every_whole_window(dataset: Path, tracks: tuple[Track, ...]) -> None:
    expected = {
        scenario_id("S3_L1_seed0_town", track.actor.actor_id, first + 49)
        for track in tracks
        for first in range(int(track.frame[0]), int(track.frame[-1]) - 108)
    }
    assert {path.name for path in (dataset / "train").iterdir()} == expected
    assert len(expected) > 300


def test_the_region_and_a_stride_give_fewer(dataset: Path, tracked_bag: Path, tmp_path: Path) -> None:
    assert main(["export", "argoverse2", str(tracked_bag), "--out", str(tmp_path / "out"), "--stride", "10"]) == 0
    near = {path.name for path in (tmp_path / "out" / "train").iterdir()}
    assert 0 < len(near) < len(list((dataset / "train").iterdir())) / 10
    assert near <= {path.name for path in (dataset / "train").iterdir()}


def test_a_scenario_is_eleven_seconds_at_10_hz(read: dict[str, Any]) -> None:
    assert read["id"] == "S3-L1-seed0-town-v1-f000060"
    assert (read["steps"], read["observed"], read["period_s"]) == (110, 50, pytest.approx(0.1))
    assert read["timesteps"] == list(range(110))
    assert read["focal"] == "AV"


def test_the_focal_track_is_the_record(read: dict[str, Any], tracks: tuple[Track, ...]) -> None:
    own = tracks[0].window(11, 110)
    assert np.array(read["places"]) == pytest.approx(np.stack((own.x_m, own.y_m), axis=-1))
    assert read["headings"] == pytest.approx(own.yaw_rad.tolist())


def test_nobody_is_dropped(read: dict[str, Any], tracks: tuple[Track, ...]) -> None:
    there = {track.actor.actor_id: len(track.window(11, 110)) for track in tracks if len(track.window(11, 110))}
    categories = {1 if key == "AV" else int(key): value for key, value in read["categories"].items()}
    assert set(categories) == set(there)
    assert categories[1] == 3
    assert all((categories[key] == 2) == (count == 110) for key, count in there.items() if key != 1)


def test_the_lane_graph_holds_together(read: dict[str, Any]) -> None:
    assert read["lanes"] > 100
    assert read["links_both_ways"] == read["links"] > 100
    assert read["neighbours_both_ways"] == read["neighbours"] > 10
    assert read["junction_lanes"] > 10
    assert read["crossings"] > 0
    assert read["near"] > 0
    assert read["driven_inside"] == 110, "the EMV drives on the drivable area"


def test_the_map_is_stored_once(dataset: Path) -> None:
    assert len({path.stat().st_ino for path in (dataset / "train").rglob("log_map_archive_*.json")}) == 1


@pytest.mark.parametrize("stride", ["0", "two", "-1"])
def test_a_stride_is_a_number_of_frames(
    tracked_bag: Path, tmp_path: Path, stride: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["export", "argoverse2", str(tracked_bag), "--out", str(tmp_path / "out"), f"--stride={stride}"]) == 2
    assert "stride" in capsys.readouterr().err


def test_windows_have_no_gaps(tracks: tuple[Track, ...]) -> None:
    for track in tracks:
        for first in whole_windows(track, 110, "region").tolist():
            window = track.window(first, 110)
            assert len(window) == 110
            assert window.in_region.all()
