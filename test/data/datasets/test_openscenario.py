"""An OpenSCENARIO document of three vehicles, read as XML: who comes when, goes where, and goes when."""

from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element

import numpy as np
import pytest
from datasets.made_tracks import made_tracks
from defusedxml.ElementTree import fromstring
from reader_environments import read_with

from siren_ros.data.datasets.files import document
from siren_ros.data.datasets.openscenario import REAR_AXLE, rear_axle, scenario

DATASET = ("openscenario", "tracked_bag")
ROOT: Element = fromstring(document(scenario(made_tracks(), "crossing.xodr", "three vehicles")))
GROUPS = {group.attrib["name"].removesuffix("Group"): group for group in ROOT.iter("ManeuverGroup")}


def times(name: str) -> dict[str, float]:
    """When each event of a vehicle begins."""
    return {
        event.attrib["name"].removeprefix(name): float(next(event.iter("SimulationTimeCondition")).attrib["value"])
        for event in GROUPS[name].iter("Event")
    }


def test_vehicles_come_when_they_were_first_recorded_and_go_when_they_were_gone():
    assert list(GROUPS) == ["Ego", "Vehicle5", "Vehicle9"]
    assert times("Ego") == {"Follows": 0.0}
    assert times("Vehicle5") == {"Added": 0.5, "Follows": 0.5}
    assert times("Vehicle9") == {"Follows": 0.0, "Removed": 1.0}
    starts = [private.attrib["entityRef"] for private in ROOT.iter("Private")]
    assert starts == ["Ego", "Vehicle9"], "who is there at the start"
    (stop,) = ROOT.iter("StopTrigger")
    assert float(next(stop.iter("SimulationTimeCondition")).attrib["value"]) == 2.0


def test_trajectories_are_those_of_the_rear_axle():
    """0.29 of the length behind the middle, against the heading of 1 rad."""
    car = made_tracks()[1]
    vertices = list(GROUPS["Vehicle5"].iter("Vertex"))
    assert [float(vertex.attrib["time"]) for vertex in vertices] == pytest.approx(0.1 * np.arange(5, 21))
    places = [next(vertex.iter("WorldPosition")).attrib for vertex in vertices]
    behind = float(np.hypot(float(places[0]["x"]) - car.x_m[0], float(places[0]["y"]) - car.y_m[0]))
    assert 0.2 * 4.0 < behind < 0.4 * 4.0
    assert [float(place["x"]) for place in places] == pytest.approx(car.x_m - behind * np.cos(1.0))
    assert [float(place["y"]) for place in places] == pytest.approx(car.y_m - behind * np.sin(1.0))
    assert {float(place["h"]) for place in places} == {1.0}
    assert rear_axle(car)[:, :2] == pytest.approx(
        np.array([(float(place["x"]), float(place["y"])) for place in places])
    )


def test_boxes_lie_around_the_vehicle():
    """The box's centre lies as far ahead of the rear axle as that is behind the middle."""
    for packed_chunk, (length, width) in zip(
        ROOT.iter("ScenarioObject"), ((6.0, 1.8), (4.0, 1.8), (12.0, 1.8)), strict=True
    ):
        centre, size = next(packed_chunk.iter("Center")).attrib, next(packed_chunk.iter("Dimensions")).attrib
        assert (float(size["length"]), float(size["width"])) == (length, width)
        front, rear = next(packed_chunk.iter("FrontAxle")).attrib, next(packed_chunk.iter("RearAxle")).attrib
        assert float(rear["positionX"]) == 0.0
        assert float(front["positionX"]) == pytest.approx(2.0 * float(centre["x"]))
        assert float(centre["z"]) == float(size["height"]) / 2.0
        assert float(front["positionZ"]) == float(front["wheelDiameter"]) / 2.0
        assert float(front["maxSteering"]) > 0.0 == float(rear["maxSteering"])
        assert float(front["trackWidth"]) < width


def test_vehicles_have_their_category_role_and_name():
    vehicles = [next(entity.iter("Vehicle")).attrib for entity in ROOT.iter("ScenarioObject")]
    assert [(vehicle["name"], vehicle["vehicleCategory"], vehicle["role"]) for vehicle in vehicles] == [
        ("ambulance", "van", "ambulance"),
        ("sedan", "car", "civil"),
        ("bus", "bus", "publicTransport"),
    ]
    kinds = [entry.attrib["value"] for entry in ROOT.iter("Property") if entry.attrib["name"] == "type"]
    assert kinds == ["ego_vehicle", "simulation", "simulation"]


def test_initial_speeds_are_those_of_the_first_frame():
    speeds = [float(element.attrib["value"]) for element in ROOT.iter("AbsoluteTargetSpeed")]
    assert speeds == pytest.approx([10.0, 5.0])
    (map_file,) = (element.attrib["filepath"] for element in ROOT.iter("LogicFile"))
    assert map_file == "crossing.xodr"


@pytest.fixture(scope="module")
def read(dataset: Path) -> dict[str, Any]:
    (file,) = dataset.glob("*.xosc")
    reading: dict[str, Any] = read_with("scenariogeneration", "read_openscenario.py", file)
    return reading


def test_it_is_valid_openscenario_1_2(read):
    assert read["errors"] == []


def test_asams_checker_finds_nothing(dataset, tmp_path):
    (file,) = dataset.glob("*.xosc")
    read = read_with("asam", "read_asam_checks.py", "qc_openscenario", file)
    assert (read["issues"], set(read["statuses"].values())) == ([], {"completed"})
    wrong = tmp_path / "wrong.xosc"
    wrong.write_text(file.read_text(encoding="utf-8").replace('"Ego"', '"Me"', 1), encoding="utf-8")
    reading = read_with("asam", "read_asam_checks.py", "qc_openscenario", wrong)["issues"]
    assert reading, "an entity that does not exist"


def test_the_map_is_there(read, dataset):
    assert (dataset / read["road"]).is_file()


def test_everybody_follows_the_recorded_trajectory(read, tracked_tracks):
    assert len(read["entities"]) == len(tracked_tracks)
    assert read["init"] == sum(track.frame[0] == 0 for track in tracked_tracks)
    for track in tracked_tracks:
        name = "Ego" if track.actor.actor_id == 1 else f"Vehicle{track.actor.actor_id}"
        times, places = read["paths"][name]
        assert times == pytest.approx((track.frame * 0.1).tolist(), abs=1e-6)
        x, y, heading = np.array(places).T
        ahead = REAR_AXLE * track.actor.length_m
        assert x + ahead * np.cos(heading) == pytest.approx(track.x_m, abs=1e-4)
        assert y + ahead * np.sin(heading) == pytest.approx(track.y_m, abs=1e-4)
