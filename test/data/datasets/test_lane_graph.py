"""Boundaries, neighbours and followers of lanes on a small crossing."""

import numpy as np
import pytest
from hand_made_record import RIGHT, SHOULDER_RIGHT, STRAIGHT, crossing

from siren_ros.data.datasets.lane_graph import lane_graph, offset_line
from siren_ros.simulation.roads.road_network import MIRROR, mirrored_network

GRAPH = lane_graph(crossing())
SHOULDER, RIGHT_LANE, LEFT_LANE, N_RIGHT, N_LEFT, E_SHOULDER, E_LANE = range(7)
PATHS = 12
"""Index of the first path across the junction."""


def test_boundaries_lie_half_a_width_aside():
    """The approach leads north at x = 5.25 m; its lanes are 3.5 m wide, the shoulder 2.5 m."""
    assert GRAPH[RIGHT_LANE].left[:, 0] == pytest.approx([3.5, 3.5])
    assert GRAPH[RIGHT_LANE].right[:, 0] == pytest.approx([7.0, 7.0])
    assert GRAPH[SHOULDER].right[:, 0] == pytest.approx([9.5, 9.5])
    assert GRAPH[RIGHT_LANE].left[:, 1].tolist() == [-120.0, -20.0]


def test_neighbours_are_of_the_same_edge():
    assert (GRAPH[RIGHT_LANE].left_neighbour, GRAPH[RIGHT_LANE].right_neighbour) == (LEFT_LANE, SHOULDER)
    assert (GRAPH[LEFT_LANE].left_neighbour, GRAPH[SHOULDER].right_neighbour) == (None, None)


def test_where_traffic_keeps_left_left_and_right_change_places():
    graph = lane_graph(mirrored_network(crossing()))
    for index, lane in GRAPH.items():
        assert graph[index].left == pytest.approx(lane.right * MIRROR)
        assert (graph[index].left_neighbour, graph[index].right_neighbour) == (
            lane.right_neighbour,
            lane.left_neighbour,
        )
        assert graph[index].inner == pytest.approx(lane.inner * MIRROR)
    assert GRAPH[LEFT_LANE].inner is GRAPH[LEFT_LANE].left


def test_followers_lead_over_paths():
    assert GRAPH[RIGHT_LANE].successors == (PATHS + STRAIGHT, PATHS + RIGHT)
    assert GRAPH[PATHS + STRAIGHT].successors == (N_RIGHT,)
    assert GRAPH[PATHS + STRAIGHT].predecessors == (RIGHT_LANE,)
    assert GRAPH[E_SHOULDER].predecessors == (PATHS + SHOULDER_RIGHT,)
    assert GRAPH[N_LEFT].successors == GRAPH[SHOULDER].predecessors == ()
    assert [index for index, lane in GRAPH.items() if lane.in_junction] == list(range(PATHS, PATHS + 7))


@pytest.mark.parametrize("left_m", [2.0, -1.0])
def test_at_a_corner_the_line_moves_along_the_mean_normal(left_m):
    """East, then north: the mean of the normals points to the north-west."""
    moved = offset_line(np.array([(0.0, 0.0), (10.0, 0.0), (10.0, 5.0)]), left_m)
    diagonal = left_m / np.sqrt(2.0)
    assert moved == pytest.approx(np.array([(0.0, left_m), (10.0 - diagonal, diagonal), (10.0 - left_m, 5.0)]))
    twice = offset_line(np.array([(0.0, 0.0), (5.0, 0.0), (5.0, 0.0), (10.0, 0.0)]), left_m)
    assert twice[:, 1] == pytest.approx(np.full(4, left_m)), "a repeated point moves with the line"
