from dataclasses import replace

import numpy as np
import pytest

from siren_ros.evaluation.prediction.siren_model.road_paths import RoadPaths
from siren_ros.numerics.polyline import Polyline
from siren_ros.roads.road_network import RoadNetwork


def test_all_ways_out_of_a_junction_the_straight_one_first(crossroads: RoadNetwork) -> None:
    paths = RoadPaths(crossroads).ahead(0, 30.0)
    assert [path.curve.points[-1].tolist() for path in paths] == [[140.0, 0.0], [20.0, 120.0], [20.0, -120.0]]
    assert [path.turn_rad for path in paths] == pytest.approx([0.0, np.pi / 2, np.pi / 2])
    assert [line.arc_m for path in paths for line in path.stop_lines] == pytest.approx([100.0] * 3)
    assert [path.stop_lines[0].movement.direction for path in paths] == ["s", "l", "r"]


def test_a_path_ends_with_its_lane_where_nothing_beyond_is_asked_for(crossroads: RoadNetwork) -> None:
    (path,) = RoadPaths(crossroads).ahead(0, 0.0)
    assert path.curve.length_m == pytest.approx(100.0)
    assert path.stop_lines == ()


def test_inside_a_junction_the_path_is_decided_and_the_stop_line_passed(crossroads: RoadNetwork) -> None:
    (path,) = RoadPaths(crossroads).ahead(4, 30.0)
    assert path.curve.points[-1].tolist() == [20.0, 120.0]
    assert path.stop_lines == ()


def test_a_dead_end_has_the_path_to_its_end(crossroads: RoadNetwork) -> None:
    (path,) = RoadPaths(crossroads).ahead(1, 50.0)
    assert path.curve.length_m == pytest.approx(100.0)


def in_two_parts(network: RoadNetwork) -> RoadNetwork:
    """The way straight across is lane 5 up to x = 15 and lane 7 from there on."""
    lanes = list(network.lanes)
    lanes[5] = replace(lanes[5], centre=Polyline.through([(0.0, 0.0), (15.0, 0.0)]))
    lanes.append(replace(lanes[5], index=7, edge=7, centre=Polyline.through([(15.0, 0.0), (40.0, 0.0)])))
    edges = (*network.edges, replace(network.edges[5], index=7, lanes=(7,)))
    return replace(network, lanes=tuple(lanes), edges=edges, connections=(replace(network.connections[1], via=(5, 7)),))


@pytest.mark.parametrize(("lane", "start_m", "length_m"), [(0, -100.0, 240.0), (5, 0.0, 140.0), (7, 15.0, 125.0)])
def test_what_is_left_of_a_way_across_a_junction(
    crossroads: RoadNetwork, lane: int, start_m: float, length_m: float
) -> None:
    (path,) = RoadPaths(in_two_parts(crossroads)).ahead(lane, 30.0)
    assert path.curve.points[0].tolist() == [start_m, 0.0]
    assert path.curve.length_m == pytest.approx(length_m)
    assert path.first_lane == lane
    assert [line.arc_m for line in path.stop_lines] == ([100.0] if lane == 0 else [])


def test_what_a_way_turns_by_is_up_to_the_start_of_the_lane_behind_the_junction(crossroads: RoadNetwork) -> None:
    """Lane 1 leaves the junction northwards, and bends to the east after half a metre."""
    lanes = list(crossroads.lanes)
    lanes[1] = replace(lanes[1], centre=Polyline.through([(20.0, 20.0), (20.0, 20.5), (120.0, 20.5)]))
    paths = RoadPaths(replace(crossroads, lanes=tuple(lanes))).ahead(0, 30.0)
    assert [path.turn_rad for path in paths] == pytest.approx([0.0, np.pi / 2.0, np.pi / 2.0])


def test_no_more_than_four_ways_the_straightest(crossroads: RoadNetwork) -> None:
    """Lane 2 ends at a second junction like the first: five ways in all, of which one turns twice as little."""
    lanes, edges = list(crossroads.lanes), list(crossroads.edges)
    onward = []
    for number, (direction, end) in enumerate((("l", (170.0, 90.0)), ("s", (260.0, 0.0)), ("r", (170.0, -50.0)))):
        index = 7 + number
        centre = Polyline.through([(140.0, 0.0), end])
        lanes.append(replace(lanes[2], index=index, edge=index, centre=centre))
        edges.append(replace(edges[2], index=index, lanes=(index,)))
        onward.append(replace(crossroads.connections[1], from_lane=2, to_lane=index, via=(), direction=direction))
    network = replace(
        crossroads, lanes=tuple(lanes), edges=tuple(edges), connections=(*crossroads.connections, *onward)
    )
    paths = RoadPaths(network).ahead(0, 200.0)
    right, left = np.arctan2(50.0, 30.0), np.arctan2(90.0, 30.0)
    assert [path.turn_rad for path in paths] == pytest.approx([0.0, right, left, np.pi / 2.0])
    assert [line.arc_m for line in paths[1].stop_lines] == pytest.approx([100.0, 240.0])
    assert RoadPaths(network).ahead(0, 30.0)[0].curve.length_m == pytest.approx(240.0), "as far as is asked for"


@pytest.mark.parametrize(("less_rad", "order"), [(0.0002, ["s", "l", "r"]), (0.002, ["s", "r", "l"])])
def test_ways_that_turn_alike_come_in_the_order_of_their_lanes(
    crossroads: RoadNetwork, less_rad: float, order: list[str]
) -> None:
    """The way to the right turns by a little less than the one to the left."""
    lanes = list(crossroads.lanes)
    angle = -np.pi / 2.0 + less_rad
    end = (20.0 + 100.0 * np.cos(angle), -20.0 + 100.0 * np.sin(angle))
    lanes[3] = replace(lanes[3], centre=Polyline.through([(20.0, -20.0), end]))
    paths = RoadPaths(replace(crossroads, lanes=tuple(lanes))).ahead(0, 30.0)
    assert [path.stop_lines[0].movement.direction for path in paths] == order
