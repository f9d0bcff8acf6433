"""CommonRoad, OpenSCENARIO, OpenDRIVE and ScenarioNet out of the bag of a drive of formulas."""

import json
import pickle
from xml.etree.ElementTree import Element

import numpy as np
import pytest
from datasets.made_bag import BUS, CAR, EMV
from defusedxml.ElementTree import parse

from siren_ros.data.datasets.openscenario import REAR_AXLE

ID = "S2_L2_seed0_straight"
ROAD = "straight-73747261.xodr"
"""The map's name with the beginning of its hash."""


def exact(state: Element, tag: str) -> float:
    return float(state.findtext(f"{tag}/exact", "nan"))


def test_commonroad_has_the_emv_as_problem_and_the_others_as_obstacles(exported, made_drive):
    out = exported("commonroad", made_drive)
    assert [path.name for path in (out / "train").iterdir()] == [f"{ID}.xml"]
    root = parse(out / "train" / f"{ID}.xml").getroot()
    assert (root.attrib["timeStepSize"], root.attrib["commonRoadVersion"]) == ("0.1", "2020a")
    assert root.attrib["benchmarkID"] == "ZAM_SirenS2straight-1_1_T-1"
    assert root.attrib["source"] == "SIREN, template S2, level L2"
    place = [root.findtext(f"location/{tag}") for tag in ("geoNameId", "gpsLatitude", "gpsLongitude")]
    assert place == ["-999", "999", "999"], "a map that is nowhere on earth"
    obstacles = {int(obstacle.attrib["id"]) - 6_000_000: obstacle for obstacle in root.findall("dynamicObstacle")}
    assert {key: obstacle.findtext("type") for key, obstacle in obstacles.items()} == {CAR: "car", BUS: "bus"}
    bus = obstacles[BUS]
    assert (bus.findtext("shape/rectangle/length"), bus.findtext("shape/rectangle/width")) == ("12", "1.8")
    times = [exact(state, "time") for state in bus.findall("trajectory/state")]
    assert times == list(range(1, 129))
    (problem,) = root.findall("planningProblem")
    assert int(problem.attrib["id"]) == 5_000_000 + EMV
    start, goal = problem.find("initialState"), problem.find("goalState")
    assert (exact(start, "velocity"), exact(start, "slipAngle")) == (10.0, 0.0)
    shape = [goal.findtext(f"position/rectangle/{tag}") for tag in ("length", "width", "orientation")]
    assert shape == ["10", "4", "0"]
    centre = [goal.findtext(f"position/rectangle/center/{tag}") for tag in ("x", "y")]
    assert centre == ["150", "-5.25"], "20 m and 13 s at 10 m/s"
    assert [goal.findtext(f"time/interval{end}") for end in ("Start", "End")] == ["65", "130"]
    card = json.loads((out / "dataset.json").read_text())
    assert (card["counts"], card["classes"]) == ({"scenarios": 1, "obstacles": 2}, {"bus": 1, "car": 1})


def test_openscenario_drives_on_the_map_that_comes_with_it(exported, made_drive):
    out = exported("openscenario", made_drive)
    assert sorted(path.name for path in out.iterdir()) == sorted(
        [f"{ID}.xosc", ROAD, "README.md", "croissant.json", "dataset.json"]
    )
    root = parse(out / f"{ID}.xosc").getroot()
    header = root.find("FileHeader")
    assert (header.attrib["revMajor"], header.attrib["revMinor"]) == ("1", "2")
    assert header.attrib["description"] == "SIREN S2, level L2, seed 0"
    assert [element.attrib["filepath"] for element in root.iter("LogicFile")] == [ROAD]
    act = next(root.iter("Act"))
    begins = act.find("StartTrigger")
    (when,) = begins.iter("SimulationTimeCondition")
    assert (float(when.attrib["value"]), when.attrib["rule"]) == (0.0, "greaterOrEqual")
    stop = root.find("Storyboard/StopTrigger")
    assert [float(element.attrib["value"]) for element in stop.iter("SimulationTimeCondition")] == [13.0]
    path = next(trajectory for trajectory in root.iter("Trajectory") if trajectory.attrib["name"] == "EgoTrajectory")
    assert path.attrib["closed"] == "false"
    places = [place.attrib for place in path.iter("WorldPosition")]
    x_m = np.array([float(place["x"]) for place in places])
    assert x_m == pytest.approx(20.0 + np.arange(131) - REAR_AXLE * 6.0, abs=1e-5)
    assert {(place["y"], place["z"], place["h"], place["p"], place["r"]) for place in places} == {
        ("-5.25", "0", "0", "0", "0")
    }
    card = json.loads((out / "dataset.json").read_text())
    assert (card["counts"], card["classes"]) == (
        {"scenarios": 1, "vehicles": 3},
        {"ambulance": 1, "bus": 1, "sedan": 1},
    )


def test_opendrive_has_the_roads_lanes_in_the_map_frame(exported, made_drive):
    out = exported("opendrive", made_drive)
    root = parse(out / ROAD).getroot()
    assert root.find("header").attrib["date"] == "1970-01-01T00:00:00"
    geometry = [curve.attrib for curve in root.iter("geometry")]
    length_m = sum(float(curve["length"]) for curve in geometry)
    assert length_m == pytest.approx(600.0), "300 m each way"
    assert {abs(float(curve["y"])) for curve in geometry} == {0.0}, "the middle of the road is y = 0"
    assert {float(curve["x"]) for curve in geometry} == {0.0, 300.0}
    widths = [float(element.attrib["a"]) for element in root.iter("width")]
    assert widths == pytest.approx([3.5] * 4)
    assert json.loads((out / "dataset.json").read_text())["counts"] == {"lanes": 4}


def test_scenarionet_has_a_database_of_the_split(exported, made_drive):
    out = exported("scenarionet", made_drive)
    name = f"sd_siren_1.0_{ID}.pkl"
    names = ["dataset_mapping.pkl", "dataset_summary.pkl", name]
    assert sorted(path.name for path in (out / "train").iterdir()) == names
    mapping, summary, scenario = (pickle.loads((out / "train" / file_name).read_bytes()) for file_name in names)  # noqa: S301 - ours
    assert mapping == {name: ""}
    assert list(summary) == [name]
    assert (scenario["id"], scenario["length"], scenario["metadata"]["sdc_id"]) == (ID, 131, str(EMV))
    assert sorted(scenario["tracks"], key=int) == [str(EMV), str(CAR), str(BUS)]
    moved = {key: summary_row["moving_distance"] for key, summary_row in summary[name]["object_summary"].items()}
    assert moved == pytest.approx({str(EMV): 130.0, str(CAR): 6.0 * 12.5 + 0.1 * 12.5**2, str(BUS): 115.2}, rel=1e-4)
    card = json.loads((out / "dataset.json").read_text())
    assert (card["counts"], card["classes"]) == ({"scenarios": 1, "tracks": 3}, {"ambulance": 1, "bus": 1, "sedan": 1})
