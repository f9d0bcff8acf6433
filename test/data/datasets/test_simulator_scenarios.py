"""OpenDRIVE and OpenSCENARIO files of an episode, and ScenarioNet descriptions of three vehicles at a signal."""

import json
import pickle
import re
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from xml.etree.ElementTree import Element

import numpy as np
import pytest
from datasets.made_bag import BUS, CAR, EMV, Export
from datasets.made_tracks import FRAMES, LANE, made_record, made_tracks
from defusedxml.ElementTree import fromstring, parse
from hand_made_record import crossing
from reader_environments import read_with
from synthetic_episode import NET_XML

from siren_ros.data.datasets.files import document
from siren_ros.data.datasets.simulator_scenarios import (
    REAR_AXLE,
    description,
    map_features,
    opendrive_of,
    rear_axle,
    scenario,
    summary_of,
)
from siren_ros.data.episode_source import open_source
from siren_ros.data.tracks import Track
from siren_ros.simulation.roads.road_network import LaneKind, mirrored_network


def test_carla_finds_the_lanes_where_they_are(dataset, tracked_bag):
    with open_source(tracked_bag) as source:
        lanes = [lane for lane in source.network.lanes if lane.kind is LaneKind.DRIVING and lane.length_m > 20.0]
    middles = np.array([lane.centre.at(np.array([lane.length_m / 2.0]))[0] for lane in lanes])
    (file,) = dataset.glob("*.xodr")
    read = read_with("carla", "read_opendrive.py", file, json.dumps(middles.tolist()))
    on_road = np.array([place[:2] for place in read["places"]])
    assert len(lanes) > 30
    off = [abs(lane.centre.project(on_road[row : row + 1])[1][0]) for row, lane in enumerate(lanes)]
    assert np.median(off) < 0.001
    assert max(off) < 0.2, "the corners of bends are cut differently"
    turned = [
        np.cos(np.radians(place[2]) - lane.centre.heading_rad(lane.length_m / 2.0))
        for place, lane in zip(read["places"], lanes, strict=True)
    ]
    assert min(turned) > 0.9, "lanes run in their direction"
    assert read["topology"] > len(lanes)


def test_asams_checker_finds_nothing_in_a_map_with_crossings(dataset):
    (file,) = dataset.glob("*.xodr")
    assert file.read_text(encoding="utf-8").count("<outline ") > 10
    read = read_with("asam", "read_asam_checks.py", "qc_opendrive", file)
    assert read["statuses"]["check_asam_xodr_xml_valid_schema"] == "completed"
    assert "error" not in read["statuses"].values()
    assert read["issues"] == []


def test_a_map_with_a_place_on_earth_keeps_it():
    """The header's offset leads from the map frame to the projection's coordinates."""
    place = 'netOffset="-561653.57,-4185149.03" convBoundary="0.00,-7.00,320.00,7.00"'
    utm = "+proj=utm +zone=10 +ellps=WGS84 +datum=WGS84 +units=m +no_defs"
    net = re.sub(r"<location [^>]*>", f'<location {place} origBoundary="0,0,1,1" projParameter="{utm}"/>', NET_XML)
    network = SimpleNamespace(sumo_offset_m=(100.0, 20.0), left_hand=False)
    source: Any = SimpleNamespace(net_xml=net, network=network, description=SimpleNamespace(map_name="far"))
    header = fromstring(opendrive_of(source)).find("header")
    assert (header.attrib["revMajor"], header.attrib["revMinor"]) == ("1", "5")
    assert str(header.findtext("geoReference")).strip() == utm
    offset = header.find("offset")
    assert [float(offset.attrib[axis]) for axis in "xy"] == [561753.57, 4185169.03]


def test_the_same_map_gives_the_same_file(exported, dataset, made_drive):
    """netconvert puts its options and the time into its files."""
    (file,) = dataset.glob("*.xodr")
    assert b"netconvertConfiguration" not in file.read_bytes()
    roads = [(exported(form, made_drive) / ROAD).read_bytes() for form in ("opendrive", "openscenario")]
    assert roads[0] == roads[1]


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
    speeds = [float(element.attrib["value"]) for element in ROOT.iter("AbsoluteTargetSpeed")]
    assert speeds == pytest.approx([10.0, 5.0]), "at the start"


def test_scenariogeneration_and_asams_checker_read_it(dataset, tracked_tracks):
    """Everybody follows the recorded trajectory, on the map that is there."""
    (file,) = dataset.glob("*.xosc")
    found = read_with("asam", "read_asam_checks.py", "qc_openscenario", file)
    assert (found["issues"], set(found["statuses"].values())) == ([], {"completed"})
    (read,) = read_with("scenariogeneration", "read_openscenario.py", file)
    assert read["errors"] == []
    assert (dataset / read["road"]).is_file()
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


ID = "S2_L2_seed0_straight"
ROAD = "straight-73747261.xodr"
"""The map's name with the beginning of its hash."""


def test_commonroad_has_the_emv_as_problem_and_the_others_as_obstacles(exported, made_drive):
    out = exported("commonroad", made_drive)
    assert [path.name for path in (out / "train").iterdir()] == [f"{ID}.xml"]
    root = parse(out / "train" / f"{ID}.xml").getroot()
    assert (root.attrib["timeStepSize"], root.attrib["commonRoadVersion"]) == ("0.1", "2020a")
    assert root.attrib["source"] == "SIREN, template S2, level L2"
    place = [root.findtext(f"location/{tag}") for tag in ("geoNameId", "gpsLatitude", "gpsLongitude")]
    assert place == ["-999", "999", "999"], "a map that is nowhere on earth"
    obstacles = {int(obstacle.attrib["id"]) - 6_000_000: obstacle for obstacle in root.findall("dynamicObstacle")}
    assert {key: obstacle.findtext("type") for key, obstacle in obstacles.items()} == {CAR: "car", BUS: "bus"}
    (problem,) = root.findall("planningProblem")
    assert int(problem.attrib["id"]) == 5_000_000 + EMV
    centre = [problem.findtext(f"goalState/position/rectangle/center/{tag}") for tag in ("x", "y")]
    assert centre == ["150", "-5.25"], "20 m and 13 s at 10 m/s"
    card = json.loads((out / "dataset.json").read_text())
    assert (card["counts"], card["classes"]) == ({"scenarios": 1, "obstacles": 2}, {"bus": 1, "car": 1})


def test_the_dialect_of_scenario_runner_is_openscenario_1_0_with_blueprints_and_places(exported, made_drive):
    out = exported("openscenario", made_drive, "--dialect", "scenario-runner")
    root = parse(out / f"{ID}.xosc").getroot()
    assert root.find("FileHeader").attrib["revMinor"] == "0"
    assert {element.attrib["rule"] for element in root.iter("SimulationTimeCondition")} == {"greaterThan"}
    names = {thing.attrib["name"]: thing.find("Vehicle").attrib["name"] for thing in root.iter("ScenarioObject")}
    assert names["Ego"] == "vehicle.ford.ambulance"
    assert all(name.startswith("vehicle.") for name in names.values())
    assert {element.attrib["entityRef"] for element in root.iter("Private")} == set(names)
    assert not list(root.iter("TrajectoryRef")) + list(root.iter("AddEntityAction"))
    path = next(line for line in root.iter("Trajectory") if line.attrib["name"] == "EgoTrajectory")
    assert [float(place.attrib["x"]) for place in path.iter("WorldPosition")][:2] == [20.0, 21.0]
    assert {float(center.attrib["x"]) for center in root.iter("Center")} == {0.0}


def test_openscenario_drives_on_the_map_that_comes_with_it(exported, made_drive):
    out = exported("openscenario", made_drive)
    files = [f"{ID}.xosc", ROAD, "README.md", "croissant.json", "dataset.json"]
    assert sorted(path.name for path in out.iterdir()) == sorted(files)
    root = parse(out / f"{ID}.xosc").getroot()
    header = root.find("FileHeader").attrib
    assert (header["revMajor"], header["revMinor"], header["description"]) == ("1", "2", "SIREN S2, level L2, seed 0")
    assert [element.attrib["filepath"] for element in root.iter("LogicFile")] == [ROAD]
    (when,) = root.find("Storyboard/Story/Act/StartTrigger").iter("SimulationTimeCondition")
    assert (float(when.attrib["value"]), when.attrib["rule"]) == (0.0, "greaterOrEqual")
    path = next(trajectory for trajectory in root.iter("Trajectory") if trajectory.attrib["name"] == "EgoTrajectory")
    places = [place.attrib for place in path.iter("WorldPosition")]
    x_m = [float(place["x"]) for place in places]
    assert x_m == pytest.approx(20.0 + np.arange(131) - REAR_AXLE * 6.0, abs=1e-5)
    assert {tuple(place[axis] for axis in "yzhpr") for place in places} == {("-5.25", "0", "0", "0", "0")}
    card = json.loads((out / "dataset.json").read_text())
    assert card["counts"] == {"scenarios": 1, "vehicles": 3}
    assert card["classes"] == {"ambulance": 1, "bus": 1, "sedan": 1}


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
    assert json.loads((out / "dataset.json").read_text())["counts"] == {"scenarios": 1, "tracks": 3}


FOUND = description(made_record(), made_tracks(), "one", 9)
PATHS = 12


def test_tracks_fill_the_frames_at_which_they_are_there():
    assert FOUND["length"] == FRAMES
    car, bus = FOUND["tracks"]["5"]["state"], FOUND["tracks"]["9"]["state"]
    assert np.flatnonzero(car["valid"]).tolist() == list(range(5, 21))
    assert np.flatnonzero(bus["valid"]).tolist() == list(range(10))
    time = 0.1 * np.arange(16)
    way = 8.0 * time + 0.25 * time**2
    assert car["position"][5:, :2] == pytest.approx(
        np.stack((20.0 + way * np.cos(1.0), 3.0 + way * np.sin(1.0)), axis=-1), abs=1e-4
    )
    assert car["velocity"][5] == pytest.approx([8.0 * np.cos(1.0), 8.0 * np.sin(1.0)], abs=1e-5)
    assert not car["position"][:5].any()
    assert (car["length"][5], car["width"][5], car["height"][5]) == pytest.approx((4.0, 1.8, 1.5))
    assert set(car["heading"][5:].tolist()) == {1.0}
    assert FOUND["tracks"]["1"]["metadata"]["is_emv"] is True
    assert FOUND["tracks"]["9"]["metadata"]["class"] == "bus"
    assert FOUND["metadata"]["ts"] == pytest.approx(0.1 * np.arange(FRAMES))
    assert FOUND["metadata"]["sdc_id"] == "9"


def test_a_light_shows_the_friendliest_movement_of_its_lane():
    """Straight on is yellow, and green from step 20 on, which is frame 10; to the right is red."""
    light = FOUND["dynamic_map_states"][str(LANE)]
    states = light["state"]["object_state"]
    assert states[:10] == ["LANE_STATE_CAUTION"] * 10
    assert states[10:] == ["LANE_STATE_GO"] * 11
    assert light["stop_point"].tolist() == [5.25, -20.0, 0.0]
    assert FOUND["dynamic_map_states"]["2"]["state"]["object_state"] == ["LANE_STATE_STOP"] * FRAMES


def test_lanes_have_their_lines_and_neighbours():
    features = map_features(crossing())
    lane = features[str(LANE)]
    assert lane["type"] == "LANE_SURFACE_STREET"
    assert (lane["left_neighbor"], lane["right_neighbor"]) == (["2"], ["0"])
    assert lane["polygon"].tolist() == [[3.5, -120.0], [3.5, -20.0], [7.0, -20.0], [7.0, -120.0]]
    assert lane["speed_limit_kmh"] == pytest.approx(13.9 * 3.6)
    assert features["1_left"]["type"] == "ROAD_LINE_BROKEN_SINGLE_WHITE"
    assert features["2_left"]["type"] == "ROAD_LINE_SOLID_SINGLE_YELLOW"
    assert "1_right" not in features
    assert features["0_right"]["polyline"].tolist() == [[9.5, -120.0, 0.0], [9.5, -20.0, 0.0]]
    assert features[str(PATHS)]["type"] == "LANE_SURFACE_UNSTRUCTURE"
    assert f"{PATHS}_left" not in features
    assert features[str(PATHS)]["entry_lanes"] == ["1"]
    assert features[str(PATHS)]["exit_lanes"] == ["3"]


def test_where_traffic_keeps_left_the_middle_of_the_road_is_on_the_right():
    features = map_features(mirrored_network(crossing()))
    assert features["2_right"]["type"] == "ROAD_LINE_SOLID_SINGLE_YELLOW"
    assert features["1_right"]["type"] == "ROAD_LINE_BROKEN_SINGLE_WHITE"
    assert "1_left" not in features
    assert features["0_left"]["polyline"].tolist() == [[9.5, 120.0, 0.0], [9.5, 20.0, 0.0]]
    lane = features[str(LANE)]
    assert (lane["left_neighbor"], lane["right_neighbor"]) == (["0"], ["2"])


def test_the_summary_counts_ways_and_vehicles():
    summary = summary_of(FOUND)
    moved = {name: summary_row["moving_distance"] for name, summary_row in summary["object_summary"].items()}
    assert moved == pytest.approx({"1": 20.0, "5": 8.0 * 1.5 + 0.25 * 1.5**2, "9": 4.5}, abs=1e-3)
    assert {name: summary_row["valid_length"] for name, summary_row in summary["object_summary"].items()} == {
        "1": 21,
        "5": 16,
        "9": 10,
    }
    assert summary["number_summary"]["num_objects"] == summary["number_summary"]["num_moving_objects"] == 3
    assert summary["number_summary"]["num_traffic_lights"] == len(FOUND["dynamic_map_states"])
    assert summary["ts"] == pytest.approx((0.1 * np.arange(FRAMES)).tolist())


def test_who_moves_less_than_a_metre_stands():
    still = description(made_record(), [track.window(0, 2) for track in made_tracks() if track.frame[0] == 0], "x", 1)
    summary = summary_of(still)["number_summary"]
    assert (summary["num_objects"], summary["num_moving_objects"]) == (2, 0)


def test_metadrive_checks_and_replays_the_episode(exported: Export, tracked_bag: Path, tracked_tracks: list[Track]):
    read = read_with("metadrive", "read_scenarionet.py", exported("scenarionet", tracked_bag) / "train")
    assert (read["scenarios"], read["length"], read["tracks"]) == (1, 140, len(tracked_tracks))
    assert read["features"] > 200
    assert read["lights"] > 10
    assert read["steps"] > 100
    assert read["travelled"] == pytest.approx(read["recorded"], rel=0.02)
    assert read["others"] > 5
