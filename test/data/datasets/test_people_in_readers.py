"""People in the datasets, as the official readers see them: an episode of formulas whose civilians are people."""

import json
from pathlib import Path

import pytest
from datasets.made_bag import BUS, CAR, THIRD, BagSpec, Export, write_made_bag
from reader_environments import read_with
from rosbags.typesys.store import Typestore

from siren_ros.simulation.world.actors import ActorClass

KINDS = (ActorClass.PEDESTRIAN, ActorClass.BICYCLE, ActorClass.MOTORCYCLE)
IDS = tuple(map(str, (CAR, BUS, THIRD)))


@pytest.fixture(scope="module")
def drive(tmp_path_factory: pytest.TempPathFactory, typestore: Typestore) -> Path:
    """Of 13.1 s without sensors."""
    spec = BagSpec(steps=262, sensed=False, kinds=KINDS)
    return write_made_bag(tmp_path_factory.mktemp("people") / "bag", typestore, spec)


@pytest.fixture(scope="module")
def sensed(tmp_path_factory: pytest.TempPathFactory, typestore: Typestore) -> Path:
    """Of 2.1 s with sensors, which see the pedestrian ahead and the cyclist behind."""
    return write_made_bag(tmp_path_factory.mktemp("people_seen") / "bag", typestore, BagSpec(kinds=KINDS))


def test_av2(exported: Export, drive: Path) -> None:
    (folder, *_) = sorted((exported("argoverse2", drive) / "train").iterdir())
    kinds = read_with("av2", "read_argoverse2.py", folder)["type_of"]
    assert [kinds[key] for key in IDS] == ["PEDESTRIAN", "CYCLIST", "MOTORCYCLIST"]


def test_commonroad_io(exported: Export, drive: Path) -> None:
    (file,) = exported("commonroad", drive).rglob("*.xml")
    found = read_with("commonroad", "read_commonroad.py", file)["obstacles"]
    assert [found[key][0] for key in IDS] == ["pedestrian", "bicycle", "motorcycle"]


def test_scenariogeneration(exported: Export, drive: Path) -> None:
    """In OpenSCENARIO 1.2, and in the 1.0 of ScenarioRunner."""
    folders = exported("openscenario", drive), exported("openscenario", drive, "--dialect", "scenario-runner")
    files = [next(folder.glob("*.xosc")) for folder in folders]
    for found in read_with("scenariogeneration", "read_openscenario.py", *files):
        assert found["errors"] == []
        expected = [["Pedestrian", "pedestrian"], ["Vehicle", "bicycle"], ["Vehicle", "motorbike"]]
        assert [found["kinds"][f"Vehicle{key}"] for key in IDS] == expected


def test_metadrive(exported: Export, drive: Path) -> None:
    """It has one type for both kinds of riders, as Waymo's dataset has."""
    kinds = read_with("metadrive", "read_scenarionet.py", exported("scenarionet", drive) / "train")["types"]
    assert [kinds[key] for key in IDS] == ["PEDESTRIAN", "CYCLIST", "CYCLIST"]


def test_open3d_ml(exported: Export, sensed: Path) -> None:
    """The front camera sees the pedestrian in the car's place."""
    folder = exported("kitti", sensed) / "training"
    number = min(path.stem for path in (folder / "label_2").glob("*.txt"))
    boxes = read_with("open3d_ml", "read_kitti.py", folder, number)[number]["boxes"]
    assert {box["class"] for box in boxes} - {"DontCare"} == {"Pedestrian"}


def test_categories_of_nuscenes(exported: Export, sensed: Path) -> None:
    folder = exported("nuscenes", sensed) / "v1.0-siren"
    tables = {name: json.loads((folder / f"{name}.json").read_text()) for name in ("instance", "category")}
    category = {row["token"]: row["name"] for row in tables["category"]}
    found = {category[row["category_token"]] for row in tables["instance"]}
    assert found == {"human.pedestrian.adult", "vehicle.bicycle"}
