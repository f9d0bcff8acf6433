"""CommonRoad's lanelets, obstacles and problem of three vehicles at a signal."""

from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element

import numpy as np
import pytest
from datasets.made_bag import Export
from datasets.made_tracks import LANE, made_record, made_tracks
from hand_made_record import EAST, RIGHT, STRAIGHT
from reader_environments import read_with

from siren_ros.datasets.commonroad import _add_obstacle, _add_problem, _root, benchmark_id, lanelet_id, obstacle_type
from siren_ros.record.episode_source import open_source
from siren_ros.record.tracks import Track, tracks_of
from siren_ros.world.actors import ActorClass

RECORD = made_record()
ROOT = _root(RECORD, RECORD.description)
LANELETS = {int(one.attrib["id"]) - 1: one for one in ROOT.findall("lanelet")}
PATHS = 12


def points(bound: Element) -> list[list[float]]:
    return [[float(one.findtext("x", "")), float(one.findtext("y", ""))] for one in bound.findall("point")]


def refs(element: Element, tag: str) -> list[int]:
    return [int(one.attrib["ref"]) - 1 for one in element.findall(tag)]


def test_a_lanelet_has_bounds_followers_and_neighbours() -> None:
    lane = LANELETS[LANE]
    left, right = lane.find("leftBound"), lane.find("rightBound")
    assert left is not None
    assert right is not None
    assert points(left) == [[3.5, -120.0], [3.5, -20.0]]
    assert points(right) == [[7.0, -120.0], [7.0, -20.0]]
    assert (left.findtext("lineMarking"), right.findtext("lineMarking")) == ("dashed", "dashed")
    assert refs(lane, "successor") == [PATHS + STRAIGHT, PATHS + RIGHT]
    assert (refs(lane, "adjacentLeft"), refs(lane, "adjacentRight")) == ([2], [0])
    assert lane.find("adjacentLeft").attrib["drivingDir"] == "same"  # type: ignore[union-attr] # it is there
    outer = LANELETS[0].find("rightBound")
    assert outer is not None
    assert outer.findtext("lineMarking") == "solid"
    assert [one.findtext("laneletType") for one in (LANELETS[0], lane, LANELETS[PATHS])] == [
        "shoulder",
        "urban",
        "intersection",
    ]
    assert [one.findtext("userOneWay") for one in (LANELETS[0], lane)] == ["priorityVehicle", "vehicle"]
    path = LANELETS[PATHS].find("leftBound")
    assert path is not None
    assert path.findtext("lineMarking") == "no_marking"
    assert lanelet_id(0) == 1


def test_opposite_lanes_share_their_left_bounds() -> None:
    """South of the junction the two directions meet at x = 0; here they lead from and to one place."""
    for lane in (LANELETS[2], LANELETS[9]):
        assert lane.find("adjacentLeft") is None, "by their junctions they are different roads"
    network = RECORD.network
    edges = tuple(replace(one, to_junction="s_in") if one.edge_id == "s_out" else one for one in network.edges)
    root = _root(replace(RECORD, network=replace(network, edges=edges)), RECORD.description)
    lanes = {int(one.attrib["id"]) - 1: one for one in root.findall("lanelet")}
    for lane, other in ((2, 9), (9, 2)):
        neighbour = lanes[lane].find("adjacentLeft")
        assert neighbour is not None
        assert (int(neighbour.attrib["ref"]) - 1, neighbour.attrib["drivingDir"]) == (other, "opposite")


def test_stop_lines_and_lights_stand_at_the_end() -> None:
    lane = LANELETS[LANE]
    line = lane.find("stopLine")
    assert line is not None
    assert points(line) == [[3.5, -20.0], [7.0, -20.0]]
    lights = {int(one.attrib["id"]): one for one in ROOT.findall("trafficLight")}
    own = [int(one.attrib["ref"]) for one in lane.findall("trafficLightRef")]
    assert [lights[number].findtext("direction") for number in own] == ["straight", "right"]
    straight, right = (lights[number] for number in own)
    told = [(one.findtext("duration"), one.findtext("color")) for one in straight.iter("cycleElement")]
    assert told == [("10", "yellow"), ("11", "green")]
    assert [(one.findtext("duration"), one.findtext("color")) for one in right.iter("cycleElement")] == [("21", "red")]
    position = straight.find("position")
    assert position is not None
    assert points(position) == [[7.0, -20.0]]


def test_the_intersection_knows_who_comes_and_where_one_goes() -> None:
    (crossing,) = ROOT.findall("intersection")
    arms = {tuple(refs(one, "incomingLanelet")): one for one in crossing.findall("incoming")}
    south, west = arms[0, 1, 2], arms[(7,)]
    assert refs(south, "outgoingStraight") == [PATHS, PATHS + 1]
    assert refs(south, "outgoingRight") == [PATHS + 2, PATHS + 3]
    assert refs(south, "outgoingLeft") == []
    assert refs(west, "outgoingStraight") == [PATHS + EAST]
    assert len({one.attrib["id"] for one in crossing.findall("incoming")}) == len(arms)
    older = _root(RECORD, RECORD.description, "successors")
    assert [one.tag for one in older.iter() if one.tag.startswith("outgoing")] == []
    told = [one.attrib for one in older.iter("successorsStraight")]
    assert told == [one.attrib for one in ROOT.iter("outgoingStraight")]


def test_speed_limits_are_signs() -> None:
    (sign,) = ROOT.findall("trafficSign")
    element = sign.find("trafficSignElement")
    assert element is not None
    assert (element.findtext("trafficSignID"), element.findtext("additionalValue")) == ("274", "13.9")
    lanes = [one for number, one in LANELETS.items() if number < 500_000]
    assert {one.find("trafficSignRef").attrib["ref"] for one in lanes} == {sign.attrib["id"]}  # type: ignore[union-attr] # it is there


def exact(state: Element, tag: str) -> float:
    return float(state.findtext(f"{tag}/exact", "nan"))


def test_obstacles_have_their_states_from_their_first_frame_on() -> None:
    root = Element("root")
    car = made_tracks()[1]
    _add_obstacle(root, car)
    (obstacle,) = root.findall("dynamicObstacle")
    states = [obstacle.find("initialState"), *obstacle.findall("trajectory/state")]
    found = [state for state in states if state is not None]
    assert [exact(state, "time") for state in found] == list(range(5, 21))
    assert [exact(state, "velocity") for state in found] == pytest.approx(8.0 + 0.05 * np.arange(16))
    assert {exact(state, "orientation") for state in found} == {1.0}
    assert {exact(state, "acceleration") for state in found} == {0.5}
    assert [float(state.findtext("position/point/x", "")) for state in found] == pytest.approx(car.x_m)
    assert (obstacle.findtext("type"), obstacle.findtext("shape/rectangle/length")) == ("car", "4")
    assert int(obstacle.attrib["id"]) % 1_000_000 == 5


def test_the_problem_is_to_be_where_the_emv_was_at_the_end() -> None:
    root = Element("root")
    _add_problem(root, made_tracks()[0])
    (problem,) = root.findall("planningProblem")
    start = problem.find("initialState")
    assert start is not None
    assert (exact(start, "time"), exact(start, "velocity"), exact(start, "yawRate")) == (0.0, 10.0, 0.0)
    goal = problem.find("goalState")
    assert goal is not None
    centre = goal.find("position/rectangle/center")
    assert centre is not None
    assert (float(centre.findtext("x", "")), float(centre.findtext("y", ""))) == (20.0, 0.0)
    assert (goal.findtext("time/intervalStart"), goal.findtext("time/intervalEnd")) == ("10", "20")


def test_the_goal_lies_along_the_last_heading() -> None:
    """Of a vehicle that drives at 1 rad and ends at frame 20."""
    root, car = Element("root"), made_tracks()[1]
    _add_problem(root, car)
    goal = root.find("planningProblem/goalState")
    start = root.find("planningProblem/initialState")
    assert goal is not None
    assert start is not None
    rectangle = [float(goal.findtext(f"position/rectangle/{tag}", "nan")) for tag in ("orientation", "length", "width")]
    assert rectangle == [1.0, 10.0, 4.0]
    centre = [float(goal.findtext(f"position/rectangle/center/{tag}", "nan")) for tag in ("x", "y")]
    assert centre == pytest.approx([car.x_m[-1], car.y_m[-1]], abs=1e-6)
    assert (exact(start, "time"), exact(start, "acceleration"), exact(start, "orientation")) == (5.0, 0.5, 1.0)
    assert (goal.findtext("time/intervalStart"), goal.findtext("time/intervalEnd")) == ("10", "20")


def test_types_and_names() -> None:
    assert [obstacle_type(one) for one in (ActorClass.SEDAN, ActorClass.BUS, ActorClass.FIRE_TRUCK)] == [
        "car",
        "bus",
        "priorityVehicle",
    ]
    assert benchmark_id(RECORD.description) == "ZAM_SirenS2made-1_1_T-1"


@pytest.fixture(scope="module")
def tracks(tracked_bag: Path) -> dict[int, Track]:
    with open_source(tracked_bag) as source:
        return {track.actor.actor_id: track for track in tracks_of(source.record())}


@pytest.fixture(scope="module")
def file(exported: Export, tracked_bag: Path) -> Path:
    return exported("commonroad", tracked_bag) / "train" / "S3_L1_seed0_town.xml"


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
