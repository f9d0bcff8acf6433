import numpy as np
import pytest

from siren_ros.roads.maps.map_compiler import compile_map
from siren_ros.roads.movements import (
    crossing_connections,
    movement_path,
    paths_cross,
    same_direction_connections,
)
from siren_ros.roads.net_parser import parse_road_network


@pytest.fixture(scope="module")
def town(tmp_path_factory):
    return parse_road_network(compile_map(None, tmp_path_factory.mktemp("maps")).read_bytes())


def movement(town, from_lane, to_lane):
    return next(
        c
        for c in town.connections
        if (town.lanes[c.from_lane].lane_id, town.lanes[c.to_lane].lane_id) == (from_lane, to_lane)
    )


def approaches(town, indices):
    return {
        (town.edges[town.lanes[town.connections[i].from_lane].edge].edge_id, town.connections[i].direction)
        for i in indices
    }


def test_straight_on_is_crossed_by_both_sides_and_by_the_oncoming_left_turn(town):
    crossing = crossing_connections(town, movement(town, "main_e_2_3", "main_e_3_3"))
    assert approaches(town, crossing) == {("east_n_0", "s"), ("east_n_0", "l"), ("east_s_1", "s"), ("main_w_0", "l")}


def test_a_right_turn_is_crossed_by_nobody(town):
    assert crossing_connections(town, movement(town, "main_e_2_2", "east_s_2_2")) == ()


def test_crossing_is_mutual(town):
    for index, connection in enumerate(town.connections):
        for other in crossing_connections(town, connection):
            if town.lanes[connection.from_lane].civilian_allowed:
                assert index in crossing_connections(town, town.connections[other])


def test_same_direction_movements_share_both_edges(town):
    same = same_direction_connections(town, movement(town, "main_e_2_3", "main_e_3_3"))
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
        ([[0, 0], [2, 2]], [[0, 2], [2, 0]], True),
        ([[0, 0], [1, 0], [2, 0]], [[1, -1], [1, 1]], True),
        ([[0, 0], [2, 0]], [[1, 0.1], [1, 1]], False),
        ([[0, 0], [2, 0]], [[0, 1], [2, 1]], False),
        ([[0, 0], [2, 0]], [[3, -1], [3, 1]], False),
    ],
)
def test_paths_cross(first, second, crosses):
    a, b = np.array(first, dtype=float), np.array(second, dtype=float)
    assert paths_cross(a, b) is crosses
    assert paths_cross(b, a) is crosses
