from dataclasses import replace

import numpy as np
import pytest
from hand_made_record import BESIDE, EAST, SOUTH, STRAIGHT, crossing
from hand_made_record import STRAIGHT_LEFT as STRAIGHT_IN_LEFT
from made_streets import A_LEFT, A_RIGHT, B_LEFT, B_RIGHT, C_LEFT, FAR, NEAR, STRAIGHT_LEFT, TURN, streets

from siren_ros.simulation.roads.movements import (
    comes_from_the_side,
    crossing_connections,
    is_plain_joint,
    movement_path,
    paths_cross,
    quiet_reach_m,
    road_lane_of,
    same_direction_connections,
)
from siren_ros.simulation.roads.road_network import NO_LANE


def movement(town, from_lane, to_lane):
    ends = town.lane_by_id[from_lane].index, town.lane_by_id[to_lane].index
    return next(c for c in town.connections if (c.from_lane, c.to_lane) == ends)


def approaches(town, indices):
    movements = [town.connections[index] for index in indices]
    return {(town.edges[town.lanes[c.from_lane].edge].edge_id, c.direction) for c in movements}


def test_straight_on_is_crossed_by_both_sides_and_by_the_oncoming_left_turn(town):
    crossing = crossing_connections(town, movement(town, "main_e_2_3", "main_e_3_2"))
    assert approaches(town, crossing) == {("east_n_0", "s"), ("east_n_0", "l"), ("east_s_1", "s"), ("main_w_0", "l")}


def test_a_right_turn_is_crossed_by_nobody(town):
    assert crossing_connections(town, movement(town, "main_e_2_2", "east_s_2_2")) == ()


def test_crossing_is_mutual(town):
    for index, connection in enumerate(town.connections):
        for other in crossing_connections(town, connection):
            if town.lanes[connection.from_lane].civilian_allowed:
                assert index in crossing_connections(town, town.connections[other])


def test_same_direction_movements_share_both_edges(town):
    same = same_direction_connections(town, movement(town, "main_e_2_3", "main_e_3_2"))
    assert [town.lanes[town.connections[i].from_lane].lane_id for i in same] == ["main_e_2_2", "main_e_2_3"]


def test_a_movement_path_joins_the_lane_ends(town):
    for connection in town.connections:
        path = movement_path(town, connection)
        start = town.lanes[connection.from_lane].centre.points[-1]
        end = town.lanes[connection.to_lane].centre.points[0]
        assert np.linalg.norm(path.points[0] - start) < 0.1
        assert np.linalg.norm(path.points[-1] - end) < 0.1


@pytest.mark.parametrize(
    ("first", "second", "crosses"),
    [
        *[([[0, 0], [2, 2]], [[0, 2], [2, 0]], True), ([[0, 0], [1, 0], [2, 0]], [[1, -1], [1, 1]], True)],
        *[([[0, 0], [2, 0]], [[1, 0.1], [1, 1]], False), ([[0, 0], [2, 0]], [[0, 1], [2, 1]], False)],
        ([[0, 0], [2, 0]], [[3, -1], [3, 1]], False),
    ],
)
def test_paths_cross(first, second, crosses):
    a, b = np.array(first, dtype=float), np.array(second, dtype=float)
    assert paths_cross(a, b) is crosses
    assert paths_cross(b, a) is crosses


def inside(network, connection):
    """The internal lane of a movement."""
    return network.connections[connection].via[0]


def test_a_lane_of_a_plain_joint_belongs_to_the_lane_before_and_one_of_a_junction_to_none():
    network = streets()
    assert [road_lane_of(network, inside(network, joint)) for joint in (0, 1, 6)] == [A_RIGHT, A_LEFT, FAR]
    for movement_at_signal in (STRAIGHT_LEFT, TURN):
        assert road_lane_of(network, inside(network, movement_at_signal)) == NO_LANE
    assert [road_lane_of(network, lane) for lane in (A_RIGHT, B_LEFT, NO_LANE)] == [A_RIGHT, B_LEFT, NO_LANE]


def test_a_plain_joint_has_one_way_on_and_one_way_in_without_control():
    network = streets()
    joint, controlled = network.connections[0], network.connections[STRAIGHT_LEFT]
    assert is_plain_joint(network, joint)
    assert not is_plain_joint(network, controlled)
    for changed in ({"signal_id": "K"}, {"must_stop": True}, {"direction": "r"}):
        other = replace(network, connections=(replace(joint, **changed), *network.connections[1:]))
        assert not is_plain_joint(other, other.connections[0])
    forked = replace(network, connections=(*network.connections, replace(joint, to_lane=NEAR)))
    assert not is_plain_joint(forked, forked.connections[0])
    joined = replace(network, connections=(*network.connections, replace(joint, from_lane=FAR)))
    assert not is_plain_joint(joined, joined.connections[0])


def test_road_before_a_lanes_end_is_counted_over_plain_joints_until_it_is_enough():
    """The lane up to J has 100 m, the joint before it 10 m, the lane before that 200 m."""
    network = streets()
    assert quiet_reach_m(network, B_RIGHT, 1000.0) == pytest.approx(310.0)
    assert quiet_reach_m(network, B_RIGHT, 100.0) == pytest.approx(100.0)
    assert quiet_reach_m(network, B_RIGHT, 100.1) == pytest.approx(310.0)
    assert quiet_reach_m(network, NEAR, 1000.0) == pytest.approx(300.0)
    assert quiet_reach_m(network, A_RIGHT, 1000.0) == pytest.approx(200.0)


def test_from_the_side_comes_who_crosses_the_street_and_neither_who_is_ahead_nor_behind():
    network = crossing()
    straight = network.connections[STRAIGHT]
    others = (STRAIGHT_IN_LEFT, EAST, SOUTH, BESIDE)
    from_side = [comes_from_the_side(network, straight, network.connections[other]) for other in others]
    assert from_side == [False, True, False, False]
    assert comes_from_the_side(network, network.connections[EAST], straight)


@pytest.mark.parametrize("lane", [B_LEFT, C_LEFT])
def test_a_movement_is_the_civilians_where_both_its_lanes_are(lane):
    roads = streets()
    assert same_direction_connections(roads, roads.connections[STRAIGHT_LEFT]) == (STRAIGHT_LEFT - 1, STRAIGHT_LEFT)
    lanes = tuple(replace(item, civilian_allowed=item.index != lane) for item in roads.lanes)
    closed = replace(roads, lanes=lanes)
    assert same_direction_connections(closed, closed.connections[STRAIGHT_LEFT]) == (STRAIGHT_LEFT - 1,)
