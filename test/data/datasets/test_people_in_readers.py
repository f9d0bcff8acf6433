"""People in the datasets, as the official readers see them: an episode of formulas whose car and bus are people."""

import json
from pathlib import Path
from typing import Any

import pytest
from datasets.made_bag import BUS, CAR, BagSpec, Export, write_made_bag
from reader_environments import read_with
from rosbags.typesys.store import Typestore

from siren_ros.simulation.world.actors import ActorClass

PAIRS = ((ActorClass.PEDESTRIAN, ActorClass.BICYCLE), (ActorClass.MOTORCYCLE, ActorClass.PEDESTRIAN))


@pytest.fixture(scope="module")
def drives(tmp_path_factory: pytest.TempPathFactory, typestore: Typestore) -> list[Path]:
    """Of 13.1 s without sensors, of each pair of classes."""
    folder = tmp_path_factory.mktemp("people")
    specs = {kinds[0].name: BagSpec(steps=262, sensed=False, kinds=kinds) for kinds in PAIRS}
    return [write_made_bag(folder / name, typestore, spec) for name, spec in specs.items()]


@pytest.fixture(scope="module")
def sensed(tmp_path_factory: pytest.TempPathFactory, typestore: Typestore) -> list[Path]:
    """Of 2.1 s with sensors, of each pair of classes."""
    folder = tmp_path_factory.mktemp("people_seen")
    return [write_made_bag(folder / kinds[0].name, typestore, BagSpec(kinds=kinds)) for kinds in PAIRS]


def told(tables: list[dict[str, Any]]) -> dict[str, Any]:
    """What the tables of the two bags say of the three classes."""
    first, second = tables
    assert second[str(BUS)] == first[str(CAR)], "two pedestrians"
    return {"pedestrian": first[str(CAR)], "bicycle": first[str(BUS)], "motorcycle": second[str(CAR)]}


def test_av2(exported: Export, drives: list[Path]) -> None:
    tables = []
    for bag in drives:
        (folder, *_) = sorted((exported("argoverse2", bag) / "train").iterdir())
        tables.append(read_with("av2", "read_argoverse2.py", folder)["type_of"])
    assert told(tables) == {"pedestrian": "PEDESTRIAN", "bicycle": "CYCLIST", "motorcycle": "MOTORCYCLIST"}


def test_commonroad_io(exported: Export, drives: list[Path]) -> None:
    tables = []
    for bag in drives:
        (file,) = exported("commonroad", bag).rglob("*.xml")
        found = read_with("commonroad", "read_commonroad.py", file)
        tables.append({name: kind for name, (kind, *_) in found["obstacles"].items()})
    assert told(tables) == {"pedestrian": "pedestrian", "bicycle": "bicycle", "motorcycle": "motorcycle"}


def test_scenariogeneration(exported: Export, drives: list[Path]) -> None:
    tables = []
    for bag in drives:
        (file,) = exported("openscenario", bag).glob("*.xosc")
        found = read_with("scenariogeneration", "read_openscenario.py", file)
        assert found["errors"] == []
        tables.append({name.removeprefix("Vehicle"): kind for name, kind in found["kinds"].items()})
    assert told(tables) == {
        "pedestrian": ["Pedestrian", "pedestrian"],
        "bicycle": ["Vehicle", "bicycle"],
        "motorcycle": ["Vehicle", "motorbike"],
    }


def test_metadrive(exported: Export, drives: list[Path]) -> None:
    """It has one type for both kinds of riders, as Waymo's dataset has."""
    folders = [exported("scenarionet", bag) / "train" for bag in drives]
    tables = [read_with("metadrive", "read_scenarionet.py", folder)["types"] for folder in folders]
    assert told(tables) == {"pedestrian": "PEDESTRIAN", "bicycle": "CYCLIST", "motorcycle": "CYCLIST"}


def test_open3d_ml(exported: Export, sensed: list[Path]) -> None:
    """The front camera sees the person in the car's place. A motorcycle is ``Misc``; this reader says ``DontCare``."""
    seen, written = [], set()
    for bag in sensed:
        folder = exported("kitti", bag) / "training"
        number = min(path.stem for path in (folder / "label_2").glob("*.txt"))
        boxes = read_with("open3d_ml", "read_kitti.py", folder, number)[number]["boxes"]
        seen.append({box["class"] for box in boxes} - {"DontCare"})
        written |= {path.read_text().split(" ")[0] for path in (folder / "label_2").glob("*.txt")}
    assert seen == [{"Pedestrian"}, set()]
    assert written == {"Pedestrian", "Misc"}


def test_nuscenes(exported: Export, sensed: list[Path], tmp_path: Path) -> None:
    """The devkit scores the person with LiDAR points by its class; nobody else has points."""
    names = []
    for number, bag in enumerate(sensed):
        out = tmp_path / str(number)
        out.mkdir()
        names.append(read_with("nuscenes", "read_nuscenes.py", exported("nuscenes", bag), "siren_train", out)["names"])
    assert names == [["pedestrian"], ["motorcycle"]]


def test_cyclists_of_nuscenes(exported: Export, sensed: list[Path]) -> None:
    folder = exported("nuscenes", sensed[0]) / "v1.0-siren"
    tables = {name: json.loads((folder / f"{name}.json").read_text()) for name in ("instance", "category")}
    category = {row["token"]: row["name"] for row in tables["category"]}
    found = {category[row["category_token"]] for row in tables["instance"]}
    assert found == {"human.pedestrian.adult", "vehicle.bicycle"}
