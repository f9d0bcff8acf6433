from itertools import pairwise

import numpy as np
import pytest

from siren_ros.errors import InputError
from siren_ros.roads.maps.map_compiler import compile_map
from siren_ros.roads.net_parser import parse_road_network
from siren_ros.roads.road_network import LaneKind
from siren_ros.roads.routing import (
    EdgeGraph,
    connections_between,
    driving_lanes,
    lanes_towards,
    path_centre,
    route_path,
    shortest_path,
)


@pytest.fixture(scope="module")
def town(tmp_path_factory):
    compiled = compile_map(None, tmp_path_factory.mktemp("maps"))
    return parse_road_network(compiled.read_bytes())


@pytest.fixture(scope="module")
def graph(town):
    return EdgeGraph.of(town)


def edges(town, names):
    return [town.edge_by_id[name].index for name in names.split()]


def names(town, indices):
    return " ".join(town.lanes[index].lane_id for index in indices)


def test_shortest_path_takes_the_short_way(town, graph):
    start, goal = edges(town, "west_n_0 oak_e_1")
    found = shortest_path(graph, start, goal)
    assert [town.edges[edge].edge_id for edge in found] == ["west_n_0", "west_n_1", "oak_e_0", "oak_e_1"]


def test_shortest_path_avoids_what_it_must(town, graph):
    start, goal, refused = edges(town, "west_n_0 oak_e_1 west_n_1")
    found = shortest_path(graph, start, goal, avoid=[refused])
    assert found is not None
    assert refused not in found
    assert graph.route_length_m(found) > graph.route_length_m(shortest_path(graph, start, goal))


def test_no_way_back_from_where_traffic_leaves(town, graph):
    start, goal = edges(town, "main_e_3 main_e_0")
    assert shortest_path(graph, start, goal) is None
    assert shortest_path(graph, start, start) == (start,)


def test_lanes_towards_are_the_lanes_that_lead_there(town):
    edge, ahead, left, right = edges(town, "main_e_2 main_e_3 east_n_1 east_s_2")
    assert names(town, lanes_towards(town, edge, ahead)) == "main_e_2_2 main_e_2_3"
    assert names(town, lanes_towards(town, edge, left)) == "main_e_2_4"
    assert names(town, lanes_towards(town, edge, right)) == "main_e_2_2"
    assert lanes_towards(town, ahead, edge) == ()


def test_driving_lanes_leave_out_shoulder_and_sidewalk(town):
    assert [lane.position for lane in driving_lanes(town, *edges(town, "main_e_1"))] == [2, 3]


def test_a_path_keeps_its_lane_through_junctions(town):
    lanes = route_path(town, edges(town, "main_e_1 main_e_2 main_e_3"), town.lane_by_id["main_e_1_3"].index)
    outside = [town.lanes[index].lane_id for index in lanes if town.lanes[index].kind is not LaneKind.INTERNAL]
    assert outside == ["main_e_1_3", "main_e_2_3", "main_e_3_3"]
    assert sum(town.lanes[index].kind is LaneKind.INTERNAL for index in lanes) >= 2


def test_a_path_changes_into_the_pocket_for_a_left_turn(town):
    lanes = route_path(town, edges(town, "main_e_1 main_e_2 east_n_1"), town.lane_by_id["main_e_1_2"].index)
    outside = [town.lanes[index].lane_id for index in lanes if town.lanes[index].kind is not LaneKind.INTERNAL]
    changes = [(a, b) for a, b in pairwise(outside) if town.lane_by_id[a].edge == town.lane_by_id[b].edge]
    assert outside[-2:] == ["main_e_2_4", "east_n_1_3"]
    assert len(changes) == 2


def test_a_path_that_starts_on_the_shoulder_stays_on_it_round_the_turn(town):
    lanes = route_path(town, edges(town, "main_w_1 main_w_2 west_n_1"), town.lane_by_id["main_w_1_1"].index)
    outside = [town.lanes[index].kind for index in lanes if town.lanes[index].kind is not LaneKind.INTERNAL]
    assert outside == [LaneKind.SHOULDER] * 3


def test_a_path_that_starts_on_a_driving_lane_never_uses_the_shoulder(town):
    lanes = route_path(town, edges(town, "main_w_1 main_w_2 west_n_1"), town.lane_by_id["main_w_1_2"].index)
    assert LaneKind.SHOULDER not in {town.lanes[index].kind for index in lanes}


@pytest.mark.parametrize("route", ["main_e_1 main_e_3", "main_e_3 main_e_0"])
def test_edges_that_do_not_follow_one_another_are_refused(town, route):
    sequence = edges(town, route)
    with pytest.raises(InputError, match="follow one another"):
        route_path(town, sequence, driving_lanes(town, sequence[0])[0].index)


def test_a_start_lane_elsewhere_is_refused(town):
    with pytest.raises(InputError, match="begin at the start lane"):
        route_path(town, edges(town, "main_e_1"), town.lane_by_id["main_w_1_2"].index)


def test_the_centre_of_a_path_is_continuous_and_as_long_as_the_road(town, graph):
    route = edges(town, "main_e_0 main_e_1 main_e_2 east_n_1")
    lanes = route_path(town, route, town.lane_by_id["main_e_0_2"].index)
    centre = path_centre(town, lanes)
    assert centre.length_m == pytest.approx(graph.route_length_m(route), rel=0.05)
    turns = np.abs(np.diff(np.unwrap(centre.resampled(2.0).heading_rad(np.arange(0.0, centre.length_m, 2.0)))))
    assert turns.max() < 0.35


def test_endless_edges_are_those_of_the_blocks(town, graph):
    endless = {town.edges[index].edge_id for index in graph.endless_edges()}
    assert {"main_e_1", "north_w_0", "oak_e_0", "west_n_0"} <= endless
    assert endless.isdisjoint({"main_e_3", "main_w_3", "west_s_4", "east_s_2", "west_n_3", "centre_n_1"})


def test_route_length_counts_the_ways_across_junctions(town, graph):
    route = edges(town, "main_e_0 main_e_1 main_e_2 main_e_3")
    assert graph.route_length_m(route) == pytest.approx(1000.0, abs=0.5)


def test_connections_between_are_ordered_from_the_right(town):
    edge, ahead = edges(town, "main_e_2 main_e_3")
    lanes = [town.lanes[connection.from_lane].position for connection in connections_between(town, edge, ahead)]
    assert lanes == [1, 2, 3]
