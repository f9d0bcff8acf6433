"""CommonRoad as commonroad-io reads it, and against its schema."""

from pathlib import Path
from typing import Any

import pytest
from reader_environments import read_with

from siren_ros.cli.main import main
from siren_ros.datasets.commonroad.exporter import obstacle_type
from siren_ros.datasets.sources.episode_source import open_source
from siren_ros.datasets.sources.tracks import Track, tracks_of
from siren_ros.world.actors import ActorClass


@pytest.fixture(scope="module")
def tracks(tracked_bag: Path) -> dict[int, Track]:
    with open_source(tracked_bag) as source:
        return {track.actor.actor_id: track for track in tracks_of(source.record())}


@pytest.fixture(scope="module")
def file(tracked_bag: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("commonroad") / "out"
    assert main(["export", "commonroad", str(tracked_bag), "--out", str(out)]) == 0
    return out / "train" / "S3_L1_seed0_town.xml"


@pytest.fixture(scope="module")
def read(file: Path) -> dict[str, Any]:
    found: dict[str, Any] = read_with("commonroad", "read_commonroad.py", file)
    return found


def test_the_library_warns_of_nothing(read: dict[str, Any], file: Path, tmp_path: Path) -> None:
    assert read["warnings"] == []
    assert min(read["behind_arms"]) > 10
    earlier = tmp_path / "earlier.xml"
    earlier.write_text(file.read_text(encoding="utf-8").replace("<outgoing", "<successors"), encoding="utf-8")
    again = read_with("commonroad", "read_commonroad.py", earlier)
    assert again["behind_arms"] == read["behind_arms"]
    assert len(again["warnings"]) == sum(read["behind_arms"])
    assert "deprecated" in again["warnings"][0]


def test_no_lanelet_crosses_itself(read: dict[str, Any]) -> None:
    assert read["crossed"] == []


def test_the_schema_is_kept_but_for_vehicles_that_come_later(read: dict[str, Any]) -> None:
    """The schema lets obstacles begin at time 0 alone; the reader takes later ones."""
    assert all("dynamicObstacle" in error and "initialState/time" in error for error in read["errors"])


def test_the_lanelets_hold_together(read: dict[str, Any]) -> None:
    assert read["id"] == "ZAM_SirenS3town-1_1_T-1"
    assert read["dt"] == 0.1
    assert read["both_ways"] == read["successors"] > 100
    assert read["adjacent"] > 20
    assert read["opposite"] > 5
    assert read["intersections"] > 5
    assert read["signs"] > 0


def test_lights_show_what_was_recorded(read: dict[str, Any]) -> None:
    assert read["lights"] > 10
    for cycle in read["light_cycles"]:
        assert sum(duration for _, duration in cycle) == 140, "14 s at 10 Hz"
    assert any(len(cycle) > 1 for cycle in read["light_cycles"])


def test_everybody_but_the_emv_is_an_obstacle(read: dict[str, Any], tracks: dict[int, Track]) -> None:
    expected = {key for key, track in tracks.items() if key != 1 and len(track) > 1}
    assert {int(key) for key in read["obstacles"]} == expected
    for key, (kind, first, last, place) in read["obstacles"].items():
        track = tracks[int(key)]
        assert kind == obstacle_type(track.actor.actor_class)
        assert (first, last) == (track.frame[0], track.frame[-1])
        assert place == pytest.approx((track.x_m[-1], track.y_m[-1]), abs=1e-4)
    assert read["on_lanelet"] >= 0.9 * len(expected)


def test_the_emv_is_the_planning_problem(read: dict[str, Any], tracks: dict[int, Track]) -> None:
    assert read["start"] == pytest.approx((tracks[1].x_m[0], tracks[1].y_m[0]), abs=1e-4)
    assert read["goal"] == pytest.approx((tracks[1].x_m[-1], tracks[1].y_m[-1]), abs=1e-3)
    assert read["goal_reached_by"] == tracks[1].frame[-1]


def test_emergency_vehicles_have_priority() -> None:
    assert obstacle_type(ActorClass.POLICE) == "priorityVehicle"
    assert (obstacle_type(ActorClass.BUS), obstacle_type(ActorClass.VAN)) == ("bus", "car")
