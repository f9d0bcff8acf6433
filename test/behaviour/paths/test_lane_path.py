import numpy as np
import pytest

from siren_ros.behaviour.paths.lane_path import (
    LaneEnd,
    changes_needed,
    connection_of_internal,
    lanes_along,
    neighbour_lane,
    path_on_lanes,
    road_limits,
)
from siren_ros.roads.road_network import NO_LANE


def route(*edges: int) -> np.ndarray:
    return np.array(edges, dtype=np.int32)


def test_changes_needed_counts_towards_the_turning_lane(lab):
    network = lab.junction_road(2)
    assert changes_needed(network, route(0, 4), civilian=True)[0] == {0: 0, 1: 1}
    assert changes_needed(network, route(0, 2), civilian=True)[0] == {0: 0, 1: 0}


def test_changes_needed_looks_beyond_the_next_edge(lab):
    road = lab.RoadBuilder()
    road.edge([[0, 0], [100, 0]], 3, ("A", "B"))
    road.edge([[100, 0], [200, 0]], 3, ("B", "C"))
    road.edge([[200, 6.6], [300, 6.6]], 1, ("C", "D"))
    for position in range(3):
        road.connect(position, 3 + position)
    road.connect(5, 6)
    needed = changes_needed(road.built(), route(0, 1, 2), civilian=True)
    assert needed[0] == {0: 2, 1: 1, 2: 0}
    assert needed[1] == {3: 2, 4: 1, 5: 0}


def test_civilians_need_lanes_of_their_own(lab):
    network = lab.straight_road(3, shoulder=True)
    assert set(changes_needed(network, route(0), civilian=True)[0]) == {1, 2}
    assert set(changes_needed(network, route(0), civilian=False)[0]) == {0, 1, 2}


def test_lanes_lead_through_the_junction(lab):
    network = lab.junction_road(2)
    lanes, end = lanes_along(network, 1, 100.0, route(0, 2), 120.0)
    assert lanes == (1, 3, 5)
    assert end is LaneEnd.HORIZON
    assert lanes_along(network, 0, 100.0, route(0, 4), 120.0)[0] == (0, 6, 7)


def test_ends_say_why(lab):
    network = lab.junction_road(2)
    assert lanes_along(network, 1, 0.0, route(0, 4), 500.0) == ((1,), LaneEnd.ASTRAY)
    assert lanes_along(network, 0, 0.0, route(0, 2), 900.0)[1] is LaneEnd.ROUTE
    assert lanes_along(network, 0, 0.0, route(0, 2), 900.0, through_junctions=False) == ((0,), LaneEnd.JUNCTION)


def test_from_inside_the_junction(lab):
    network = lab.junction_road(2)
    lanes, end = lanes_along(network, 6, 3.0, route(0, 4), 100.0)
    assert lanes == (6, 7)
    assert end is LaneEnd.HORIZON


def test_plain_joints_do_not_stop_a_civilian(lab):
    road = lab.RoadBuilder()
    road.edge([[0, 0], [60, 0]], 2, ("A", "B"))
    road.edge([[60, 0], [200, 0]], 2, ("B", "C"))
    road.connect(0, 2)
    road.connect(1, 3)
    lanes, end = lanes_along(road.built(), 0, 10.0, route(0, 1), 80.0, civilian=True, through_junctions=False)
    assert lanes == (0, 2)
    assert end is LaneEnd.HORIZON


def test_where_a_lane_fans_out_the_way_goes_straight_on(lab):
    road = lab.RoadBuilder()
    road.edge([[0, 0], [60, 0]], 1, ("A", "B"))
    road.edge([[70, -3.3], [200, -3.3]], 3, ("B", "C"))
    for left in (-3.3, 0.0, 3.3):
        road.edge([[60, 0], [64, 0], [66, left], [70, left]], 1, ("B", "B"), internal=True)
    for position in range(3):
        road.connect(0, 1 + position, via=(4 + position,))
    assert lanes_along(road.built(), 0, 10.0, route(0, 1), 80.0)[0] == (0, 5, 2)


def test_path_on_lanes_follows_the_turn_and_knows_its_lanes(lab):
    network = lab.junction_road(2)
    lanes, end = lanes_along(network, 0, 100.0, route(0, 4), 120.0)
    path = path_on_lanes(network, lanes, end, 90.0, 120.0)
    assert path.curve.points[0] == pytest.approx([90.0, 0.0], abs=1e-6)
    assert path.curve.length_m == pytest.approx(120.0, rel=0.02)
    along = path.lane_at(np.array([0.0, 55.0, 65.0, 100.0]))
    assert along.tolist() == [0, 0, 6, 7]
    assert path.curve.heading_rad[-1] == pytest.approx(-np.pi / 2.0, abs=1e-3)
    assert np.abs(path.curve.curvature_1pm).max() < 0.16


def test_neighbours_and_limits(lab):
    network = lab.straight_road(3, shoulder=True)
    assert neighbour_lane(network, 0, -1) == NO_LANE
    assert neighbour_lane(network, 1, 1) == 2
    limits = road_limits(network, 1)
    assert (limits.right_m, limits.driving_right_m, limits.left_m, limits.opposite_m) == pytest.approx(
        (-4.95, -1.65, 4.95, 0.0)
    )


def test_opposite_lane_is_found_by_the_junctions(lab):
    road = lab.RoadBuilder()
    road.edge([[0, 0], [100, 0]], 1, ("A", "B"))
    road.edge([[100, 3.3], [0, 3.3]], 1, ("B", "A"))
    assert road_limits(road.built(), 0).opposite_m == pytest.approx(3.3)


def test_an_internal_lane_belongs_to_the_movement_along_the_route_and_else_to_the_first(lab):
    """Two movements share the first of their lanes across the junction."""
    road = lab.RoadBuilder()
    road.edge([[0, 0], [100, 0]], 1, ("W", "J"))
    road.edge([[100, 0], [110, 0]], 1, ("J", "J"), internal=True)
    road.edge([[110, 0], [200, 0]], 1, ("J", "E"))
    road.edge([[110, 0], [110, 90]], 1, ("J", "N"))
    road.connect(0, 2, via=(1,))
    road.connect(0, 3, via=(1,), direction="l")
    network = road.built()
    assert connection_of_internal(network, 1, route(0, 2)).to_lane == 2
    assert connection_of_internal(network, 1, route(0, 3)).to_lane == 3
    assert connection_of_internal(network, 1, route(7)).to_lane == 2
    assert connection_of_internal(network, 2, route(0, 2)) is None
    assert lanes_along(network, 1, 2.0, route(0, 3), 50.0)[0] == (1, 3)
