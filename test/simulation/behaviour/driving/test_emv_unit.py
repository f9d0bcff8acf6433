"""Lanes that the EMV needs for its route, and the plan that follows it."""

import numpy as np
import pytest

from siren_ros.simulation.behaviour.driving.emv_unit import (
    RoutePlan,
    best_lane,
    plan_route,
    present_lane,
    strategic_side,
)
from siren_ros.simulation.behaviour.driving.navigator import NavigatorState
from siren_ros.simulation.behaviour.driving.speed_mechanisms import ESCAPE_HORIZON_M
from siren_ros.simulation.behaviour.emv.gap_escape import reference_line, road_space
from siren_ros.simulation.behaviour.paths.lane_path import LaneEnd
from siren_ros.simulation.roads.road_network import NO_LANE
from siren_ros.simulation.world.actors import ActorClass

AMBULANCE = ActorClass.AMBULANCE


def route(*edges):
    return np.array(edges, dtype=np.int32)


def fork(lab):
    """Three lanes; the left one leads to edge 1, the middle and the right one to edge 2."""
    road = lab.RoadBuilder().edge([[0, 0], [100, 0]], 3, ("A", "B"))
    road.edge([[100, 6.6], [200, 60]], 1, ("B", "C"))
    road.edge([[100, 0], [200, 0]], 2, ("B", "D"))
    return road.connect(2, 3, direction="l").connect(0, 4).connect(1, 5).built()


@pytest.mark.parametrize(
    ("lane", "edges", "side"),
    [
        *[(0, (0, 1), 1), (1, (0, 1), 1), (2, (0, 1), 0), (2, (0, 2), -1)],
        *[(1, (0, 2), 0), (0, (0, 2), 0), (0, (1,), 0), (0, (), 0)],
    ],
)
def test_the_side_to_change_to(lab, lane, edges, side):
    assert strategic_side(fork(lab), lane, route(*edges)) == side


@pytest.mark.parametrize(
    ("lane", "edges", "best"),
    [(0, (0, 1), 2), (2, (0, 1), 2), (2, (0, 2), 1), (0, (0, 2), 0), (1, (1,), 1), (2, (), 2)],
)
def test_the_lane_that_serves_the_route_best_and_is_nearest(lab, lane, edges, best):
    assert best_lane(fork(lab), lane, route(*edges)) == best


def view_at(lab, network, lane, s, edges, speed=8.0, left=0.0):
    return lab.view(network, lab.L1, [lab.Car(1, lane, s, speed, edges, AMBULANCE, left=left)], step=7)


def test_a_plan_knows_its_edges_its_end_and_its_step(lab, junction):
    plan, navigator = plan_route(view_at(lab, junction, 0, 60, (0, 2)).ego(0), 0, NavigatorState())
    assert (plan.edges, plan.end, plan.planned_step) == ((0, 2), LaneEnd.HORIZON, 7)
    assert navigator.left_m == pytest.approx(0.0, abs=1e-6)
    plan, navigator = plan_route(view_at(lab, junction, 1, 60, (0, 4)).ego(0), 1, NavigatorState())
    assert plan.end is LaneEnd.ASTRAY
    assert navigator.path.curve.points[-1, 0] == pytest.approx(150.0 - 3.25 - 1.0)
    assert navigator.path.speed_cap_mps(navigator.path.length_m) < 0.1


def test_the_path_stops_before_the_routes_end(lab):
    network = lab.straight_road(2, 120.0)
    plan, navigator = plan_route(view_at(lab, network, 0, 60, (0,)).ego(0), 0, NavigatorState())
    assert plan.end is LaneEnd.ROUTE
    assert navigator.path.curve.points[-1, 0] == pytest.approx(120.0 - 3.25 - 3.0)
    assert navigator.path.speed_cap_mps(navigator.path.length_m) < 0.1


@pytest.mark.parametrize(("left", "from_behind"), [(0.4, True), (-0.4, True), (0.6, False), (-0.6, False)])
def test_small_offsets_are_left_to_the_tracking_and_large_ones_get_a_path_of_their_own(lab, left, from_behind):
    """The line of the lane begins 10 m behind; a path back to it begins at the vehicle."""
    view = view_at(lab, lab.straight_road(1, 400.0), 0, 60, (0,), left=left)
    _, navigator = plan_route(view.ego(0), 0, NavigatorState())
    assert navigator.path.curve.points[0] == pytest.approx((50.0, 0.0) if from_behind else (60.0, left), abs=1e-6)


@pytest.mark.parametrize(
    ("edges", "ahead", "agrees"),
    [
        *[((4, 5), (4, 5, 6), True), ((4, 5, 6), (5, 6), True), ((4, 5), (3, 4, 5), True), ((4, 5), (4, 7), False)],
        *[((4, 5), (7, 8), False), ((4, 5), (8, 9), False), ((4, 5), (), False)],
        *[((4, 5), (5,), True), ((4, 5), (5, 9), True)],
    ],
)
def test_a_plan_agrees_with_a_route_as_far_as_both_reach(edges, ahead, agrees):
    assert RoutePlan(edges, LaneEnd.HORIZON, 0).agrees_with(route(*ahead)) is agrees


def test_the_present_lane_is_the_paths_while_it_is_on_the_route(lab, junction):
    view = view_at(lab, junction, 1, 60, (0, 2))
    _, navigator = plan_route(view.ego(0), 0, NavigatorState())
    assert (present_lane(view.ego(0), NavigatorState()), present_lane(view.ego(0), navigator)) == (1, 0)
    assert present_lane(view_at(lab, junction, 4, 10, (2,)).ego(0), navigator) == 4
    assert NO_LANE == -1


def test_the_line_of_the_escape_search_begins_behind_the_rear_axle(lab):
    view = view_at(lab, lab.straight_road(2), 0, 100, (0,))
    line = reference_line(view.ego(0), 0)
    assert line.curve.points[0] == pytest.approx((95.0, 0.0), abs=1e-6)
    assert line.curve.length_m == pytest.approx(ESCAPE_HORIZON_M + 10.0)


def test_the_edges_of_the_road_beside_a_line(lab):
    """Lanes 3.3 m wide, a shoulder on the right and an opposite road of two lanes on the left."""
    road = lab.RoadBuilder().edge([[0, 0], [300, 0]], 3, ("A", "B"), shoulder=True)
    road.edge([[300, 13.2], [0, 13.2]], 2, ("B", "A"))
    network = road.built()
    view = view_at(lab, network, 1, 100, (0,))
    space = road_space(network, reference_line(view.ego(0), 1), np.array([10.0, 20.0]))
    np.testing.assert_allclose(space.right_m, -1.5 * 3.3)
    np.testing.assert_allclose(space.driving_right_m, -0.5 * 3.3)
    np.testing.assert_allclose(space.left_m, 1.5 * 3.3)
    np.testing.assert_allclose(space.opposite_left_m, 3.5 * 3.3)
    np.testing.assert_allclose(space.middle_m, 0.5 * 3.3)


@pytest.mark.parametrize(
    ("turned", "from_behind"), [(0.0, True), (0.29, True), (-0.29, True), (0.31, False), (-0.31, False), (np.pi, False)]
)
def test_an_emv_that_points_elsewhere_gets_a_path_from_its_own_pose(lab, straight, turned, from_behind):
    poses = np.array([[100.0, 0.0, turned, 5.0]])
    traffic = lab.traffic_of(straight, [lab.Car(1, 0, 100, 5, (0,), AMBULANCE)], poses=poses)
    _, navigator = plan_route(lab.view_of(lab.world_of(straight, lab.L1), traffic).ego(0), 0, NavigatorState())
    assert float(navigator.path.curve.points[0, 0]) == pytest.approx(90.0 if from_behind else 100.0, abs=0.01)


def test_lanes_that_only_an_emv_may_use_count_for_it(lab):
    """The turn to the right leads from the shoulder alone."""
    road = lab.RoadBuilder().edge([[0.0, 0.0], [150.0, 0.0]], 3, ("W", "J"), shoulder=True)
    road.edge([[160.0, -10.0], [160.0, -100.0]], 1, ("J", "S"))
    road.connect(0, 3, direction="r")
    network = road.built()
    assert [strategic_side(network, lane, route(0, 1)) for lane in (0, 1, 2)] == [0, -1, -1]
    assert [best_lane(network, lane, route(0, 1)) for lane in (0, 1, 2)] == [0, 0, 0]
