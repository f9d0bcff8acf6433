"""An OpenSCENARIO document of three vehicles, read as XML: who comes when, goes where, and goes when."""

from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element

import numpy as np
import pytest
from datasets.made_bag import Export
from datasets.made_tracks import made_tracks
from defusedxml.ElementTree import fromstring
from reader_environments import read_with

from siren_ros.datasets.files import document
from siren_ros.datasets.openscenario import REAR_AXLE, rear_axle, scenario
from siren_ros.record.episode_source import open_source
from siren_ros.record.tracks import Track, tracks_of

ROOT: Element = fromstring(document(scenario(made_tracks(), "crossing.xodr", "three vehicles")))
GROUPS = {group.attrib["name"].removesuffix("Group"): group for group in ROOT.iter("ManeuverGroup")}


def times(name: str) -> dict[str, float]:
    """When each event of a vehicle begins."""
    return {
        event.attrib["name"].removeprefix(name): float(next(event.iter("SimulationTimeCondition")).attrib["value"])
        for event in GROUPS[name].iter("Event")
    }


def test_vehicles_come_when_they_were_first_recorded_and_go_when_they_were_gone() -> None:
    assert list(GROUPS) == ["Ego", "Vehicle5", "Vehicle9"]
    assert times("Ego") == {"Follows": 0.0}
    assert times("Vehicle5") == {"Added": 0.5, "Follows": 0.5}
    assert times("Vehicle9") == {"Follows": 0.0, "Removed": 1.0}
    starts = [private.attrib["entityRef"] for private in ROOT.iter("Private")]
    assert starts == ["Ego", "Vehicle9"], "who is there at the start"
    (stop,) = ROOT.iter("StopTrigger")
    assert float(next(stop.iter("SimulationTimeCondition")).attrib["value"]) == 2.0


def test_trajectories_are_those_of_the_rear_axle() -> None:
    """0.29 of the length behind the middle, against the heading of 1 rad."""
    car = made_tracks()[1]
    vertices = list(GROUPS["Vehicle5"].iter("Vertex"))
    assert [float(one.attrib["time"]) for one in vertices] == pytest.approx(0.1 * np.arange(5, 21))
    places = [next(one.iter("WorldPosition")).attrib for one in vertices]
    behind = float(np.hypot(float(places[0]["x"]) - car.x_m[0], float(places[0]["y"]) - car.y_m[0]))
    assert 0.2 * 4.0 < behind < 0.4 * 4.0
    assert [float(one["x"]) for one in places] == pytest.approx(car.x_m - behind * np.cos(1.0))
    assert [float(one["y"]) for one in places] == pytest.approx(car.y_m - behind * np.sin(1.0))
    assert {float(one["h"]) for one in places} == {1.0}
    assert rear_axle(car)[:, :2] == pytest.approx(np.array([(float(one["x"]), float(one["y"])) for one in places]))


def test_boxes_lie_around_the_vehicle() -> None:
    """The box's centre lies as far ahead of the rear axle as that is behind the middle."""
    for made, (length, width) in zip(ROOT.iter("ScenarioObject"), ((6.0, 1.8), (4.0, 1.8), (12.0, 1.8)), strict=True):
        centre, size = next(made.iter("Center")).attrib, next(made.iter("Dimensions")).attrib
        assert (float(size["length"]), float(size["width"])) == (length, width)
        front, rear = next(made.iter("FrontAxle")).attrib, next(made.iter("RearAxle")).attrib
        assert float(rear["positionX"]) == 0.0
        assert float(front["positionX"]) == pytest.approx(2.0 * float(centre["x"]))
        assert float(centre["z"]) == float(size["height"]) / 2.0
        assert float(front["positionZ"]) == float(front["wheelDiameter"]) / 2.0
        assert float(front["maxSteering"]) > 0.0 == float(rear["maxSteering"])
        assert float(front["trackWidth"]) < width


def test_vehicles_have_their_category_role_and_name() -> None:
    told = [next(made.iter("Vehicle")).attrib for made in ROOT.iter("ScenarioObject")]
    assert [(one["name"], one["vehicleCategory"], one["role"]) for one in told] == [
        ("ambulance", "van", "ambulance"),
        ("sedan", "car", "civil"),
        ("bus", "bus", "publicTransport"),
    ]
    kinds = [one.attrib["value"] for one in ROOT.iter("Property") if one.attrib["name"] == "type"]
    assert kinds == ["ego_vehicle", "simulation", "simulation"]


def test_initial_speeds_are_those_of_the_first_frame() -> None:
    speeds = [float(one.attrib["value"]) for one in ROOT.iter("AbsoluteTargetSpeed")]
    assert speeds == pytest.approx([10.0, 5.0])
    (map_file,) = (one.attrib["filepath"] for one in ROOT.iter("LogicFile"))
    assert map_file == "crossing.xodr"


@pytest.fixture(scope="module")
def tracks(tracked_bag: Path) -> list[Track]:
    with open_source(tracked_bag) as source:
        return [track for track in tracks_of(source.record()) if len(track) > 1]


@pytest.fixture(scope="module")
def dataset(exported: Export, tracked_bag: Path) -> Path:
    return exported("openscenario", tracked_bag)


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
