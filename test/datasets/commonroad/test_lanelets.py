"""CommonRoad's lanelets, obstacles and problem of three vehicles at a signal."""

from dataclasses import replace
from xml.etree.ElementTree import Element

import numpy as np
import pytest
from datasets.made_tracks import LANE, made_record, made_tracks
from hand_made_record import EAST, RIGHT, STRAIGHT

from siren_ros.datasets.commonroad.exporter import (
    _add_obstacle,
    _add_problem,
    _root,
    benchmark_id,
    obstacle_type,
)
from siren_ros.datasets.commonroad.lanelets import lanelet_id
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
