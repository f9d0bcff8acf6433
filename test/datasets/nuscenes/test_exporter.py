"""nuScenes as nuscenes-devkit reads it."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from reader_environments import read_with

from siren_ros.cli.main import main
from siren_ros.datasets.nuscenes.rig import NUSCENES_FROM_LIDAR
from siren_ros.datasets.nuscenes.taxonomy import CATEGORY_OF_CLASS, category_of, visibility_of
from siren_ros.datasets.sources.episode_source import open_source
from siren_ros.datasets.sources.lidar_frames import lidar_frames
from siren_ros.world.actors import ActorClass


@pytest.fixture(scope="module")
def dataset(sensed_bag: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("nuscenes") / "out"
    assert main(["export", "nuscenes", str(sensed_bag), "--out", str(out)]) == 0
    return out


@pytest.fixture(scope="module")
def read(dataset: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    found: dict[str, Any] = read_with(
        "nuscenes", "read_nuscenes.py", dataset, "siren_train", tmp_path_factory.mktemp("drawn")
    )
    return found


def test_the_devkit_loads_scenes_samples_and_all_cameras(read: dict[str, Any]) -> None:
    assert read["samples"] == 4
    assert read["channels"] == ["CAM_BACK", "CAM_BACK_LEFT", "CAM_BACK_RIGHT", "CAM_FRONT", "LIDAR_TOP"]
    assert {"vehicle.car"} <= set(read["categories"]) <= set(CATEGORY_OF_CLASS.values())


def test_a_sweep_has_five_floats_a_point_and_ten_sweeps_of_history(read: dict[str, Any]) -> None:
    assert read["floats"] == read["points"] > 10_000
    assert read["sweeps"] == 10
    assert read["history_s"] == pytest.approx(0.45)


def test_boxes_tell_how_many_points_lie_in_them(read: dict[str, Any], sensed_bag: Path) -> None:
    """nuScenes counts all points in a box: the ground under a vehicle too, but no mirror that sticks out of it."""
    hits = np.array(read["hits"])
    assert (hits[:, 1] > 0).sum() >= 12
    assert hits[:, 1].tolist() == hits[:, 0].tolist()
    with open_source(sensed_bag) as source:
        keys = [frame.truth for frame in lidar_frames(source) if frame.step % 10 == 0 and frame.points is not None]
    returns = np.concatenate([truth.lidar_points for truth in keys if truth is not None])
    assert hits[:, 1].tolist() != returns.tolist(), "it is not the number of returns of the vehicle"


def test_only_boxes_without_another_before_and_after_have_no_velocity(read: dict[str, Any]) -> None:
    assert all(links == ["", ""] for links in read["without_velocity"])


def test_its_own_annotations_score_fully(read: dict[str, Any]) -> None:
    assert read["car_ap"] == pytest.approx(1.0)
    assert max(read["car_errors"].values()) == pytest.approx(0.0, abs=1e-9)


def test_the_vehicle_stands_on_the_drivable_map(read: dict[str, Any]) -> None:
    assert read["on_road"]


def test_the_devkits_map_and_prediction_tools_read_the_vector_map(dataset: Path) -> None:
    read = read_with("nuscenes", "read_nuscenes_map.py", dataset)
    assert read["refused"], "the devkit takes the names of its own four maps, until its list is changed"
    assert read["name"].startswith("town-")
    assert min(count for layer, count in read["rows"].items() if layer != "carpark_area") > 0
    assert [layer for layer, there in read["layers"].items() if there][:4] == [
        *("drivable_area", "road_segment", "road_block", "lane"),
    ]
    assert (read["on_road"], read["known"], read["cues"]) == (1.0, True, ["VERTICAL"])
    assert read["off_lane_m"] < 1.0
    assert max(read["steps_m"]) < 0.5, "a lane begins where the one before it ends"
    assert all(0.0 < share < 1.0 for share in read["shares"])
    assert read["picture"][:3] == [500, 500, 3]
    assert read["picture"][3] > 10.0


def test_velocities_are_those_of_the_record(read: dict[str, Any], sensed_bag: Path) -> None:
    with open_source(sensed_bag) as source:
        truth = next(frame.truth for frame in lidar_frames(source) if frame.step == 10)
    assert truth is not None
    recorded = sorted(np.hypot(truth.vx_mps, truth.vy_mps).tolist())
    assert sorted(speed for speed, _ in read["speeds"]) == pytest.approx(recorded, abs=0.6)


def test_tables_name_only_what_is_there(dataset: Path) -> None:
    tables = {path.stem: json.loads(path.read_text()) for path in (dataset / "v1.0-siren").glob("*.json")}
    tokens = {name: {row["token"] for row in rows} for name, rows in tables.items() if name != "splits"}
    for name, rows in tables.items():
        if name == "splits":
            continue
        assert len(tokens[name]) == len(rows)
        for row in rows:
            for key, value in row.items():
                if key.endswith("_token") and not key.startswith(("first", "last")):
                    assert value in tokens[key.removesuffix("_token")], (name, key)
                if key in {"prev", "next"} and value:
                    assert value in tokens[name]
    names = {row["filename"] for row in tables["sample_data"]}
    there = {str(path.relative_to(dataset)) for kind in ("samples", "sweeps") for path in (dataset / kind).rglob("*.*")}
    assert names == there
    assert tables["splits"]["siren_train"] == [tables["scene"][0]["name"]]


def test_x_points_to_the_right_and_y_ahead() -> None:
    assert (NUSCENES_FROM_LIDAR @ [1.0, 0.0, 0.0, 1.0])[:3].tolist() == [0.0, 1.0, 0.0]
    assert (NUSCENES_FROM_LIDAR @ [0.0, 1.0, 0.0, 1.0])[:3].tolist() == [-1.0, 0.0, 0.0]


def test_emergency_vehicles_are_cars_unless_asked_for() -> None:
    assert set(CATEGORY_OF_CLASS) == set(ActorClass)
    assert category_of(ActorClass.AMBULANCE, "vehicle.car") == "vehicle.car"
    assert category_of(ActorClass.AMBULANCE, "vehicle.emergency") == "vehicle.emergency.ambulance"
    assert category_of(ActorClass.BUS, "vehicle.car") == "vehicle.bus.rigid"


@pytest.mark.parametrize(
    ("fraction", "level"), [(0.0, "1"), (0.39, "1"), (0.4, "2"), (0.6, "3"), (0.79, "3"), (0.8, "4"), (1.0, "4")]
)
def test_visibility_levels(fraction: float, level: str) -> None:
    assert visibility_of(fraction) == level
