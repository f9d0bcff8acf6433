"""OpenSCENARIO as scenariogeneration reads it, and against its schema."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from reader_environments import read_with

from siren_ros.cli.main import main
from siren_ros.datasets.openscenario.entities import REAR_AXLE
from siren_ros.datasets.sources.episode_source import open_source
from siren_ros.datasets.sources.tracks import Track, tracks_of


@pytest.fixture(scope="module")
def tracks(tracked_bag: Path) -> list[Track]:
    with open_source(tracked_bag) as source:
        return [track for track in tracks_of(source.record()) if len(track) > 1]


@pytest.fixture(scope="module")
def dataset(tracked_bag: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("openscenario") / "out"
    assert main(["export", "openscenario", str(tracked_bag), "--out", str(out)]) == 0
    return out


@pytest.fixture(scope="module")
def read(dataset: Path) -> dict[str, Any]:
    (file,) = dataset.glob("*.xosc")
    found: dict[str, Any] = read_with("scenariogeneration", "read_openscenario.py", file)
    return found


def test_it_is_valid_openscenario_1_2(read: dict[str, Any]) -> None:
    assert read["errors"] == []


def test_asams_checker_finds_nothing(dataset: Path, tmp_path: Path) -> None:
    (file,) = dataset.glob("*.xosc")
    read = read_with("asam", "read_asam_checks.py", "qc_openscenario", file)
    assert (read["issues"], set(read["statuses"].values())) == ([], {"completed"})
    wrong = tmp_path / "wrong.xosc"
    wrong.write_text(file.read_text(encoding="utf-8").replace('"Ego"', '"Me"', 1), encoding="utf-8")
    found = read_with("asam", "read_asam_checks.py", "qc_openscenario", wrong)["issues"]
    assert found, "an entity that does not exist"


def test_the_map_is_there(read: dict[str, Any], dataset: Path) -> None:
    assert (dataset / read["road"]).is_file()


def test_everybody_follows_the_recorded_trajectory(read: dict[str, Any], tracks: list[Track]) -> None:
    assert len(read["entities"]) == len(tracks)
    assert read["init"] == sum(track.frame[0] == 0 for track in tracks)
    for track in tracks:
        name = "Ego" if track.actor.actor_id == 1 else f"Vehicle{track.actor.actor_id}"
        times, places = read["paths"][name]
        assert times == pytest.approx((track.frame * 0.1).tolist(), abs=1e-6)
        x, y, heading = np.array(places).T
        ahead = REAR_AXLE * track.actor.length_m
        assert x + ahead * np.cos(heading) == pytest.approx(track.x_m, abs=1e-4)
        assert y + ahead * np.sin(heading) == pytest.approx(track.y_m, abs=1e-4)
