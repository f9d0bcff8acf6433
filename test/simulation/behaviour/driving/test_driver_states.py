"""States of drivers: draws of civilians, lanes that the EMV needs, and guards on roads that point anywhere."""

from collections import Counter

import numpy as np
import pytest

from siren_ros.simulation.behaviour.driving.driver_states import (
    Compliance,
    RoutePlan,
    best_lane,
    draw_driver,
    emv_fully_passed,
    plan_route,
    present_lane,
    strategic_side,
)
from siren_ros.simulation.behaviour.driving.navigator import NavigatorState
from siren_ros.simulation.behaviour.driving.speed_mechanisms import (
    ESCAPE_HORIZON_M,
)
from siren_ros.simulation.behaviour.driving.tracked_path import LaneEnd
from siren_ros.simulation.behaviour.emv.controller import (
    reference_line,
)
from siren_ros.simulation.scenario.presets import load_preset
from siren_ros.simulation.world.actors import ActorClass


def test_the_papers_driver_is_deterministic():
    drivers = {draw_driver(load_preset("paper"), seed, actor) for seed in range(3) for actor in range(1, 30)}
    assert len(drivers) == 1
    driver = drivers.pop()
    assert (driver.compliance, driver.delay_s, driver.response_distance_m) == (Compliance.COMPLIES, 0.0, 40.0)


def test_realistic_drivers_differ_and_repeat():
    preset = load_preset("realistic")
    drivers = [draw_driver(preset, 5, actor) for actor in range(1, 400)]
    assert drivers == [draw_driver(preset, 5, actor) for actor in range(1, 400)]
    assert drivers != [draw_driver(preset, 6, actor) for actor in range(1, 400)]
    shares = Counter(driver.compliance for driver in drivers)
    assert shares[Compliance.COMPLIES] / 399 == pytest.approx(0.85, abs=0.06)
    assert shares[Compliance.LATE] > 0
    assert shares[Compliance.NEVER] > 0


def test_late_drivers_take_longer():
    preset = load_preset("realistic")
    drivers = [draw_driver(preset, 0, actor) for actor in range(1, 600)]
    mean = {
        kind: sum(d.delay_s for d in drivers if d.compliance is kind) / sum(d.compliance is kind for d in drivers)
        for kind in (Compliance.COMPLIES, Compliance.LATE)
    }
    assert mean[Compliance.LATE] > mean[Compliance.COMPLIES] + 1.5


AMBULANCE = ActorClass.AMBULANCE


@pytest.mark.parametrize("turn", np.radians([30.0, 60.0, 140.0, -100.0]))
@pytest.mark.parametrize(
    ("ahead", "left", "yaw", "passed"),
    [
        *[(6.62, 3.3, 0.0, False), (6.63, 3.3, 0.0, True), (6.63, -3.3, 0.0, True)],
        *[(0.0, 8.0, 0.0, False), (-6.7, 0.0, 0.0, False), (1.0 + 2.375 + 1.04, 5.0, np.pi / 2.0, False)],
        *[(1.0 + 2.375 + 1.04, 5.0, -np.pi / 2.0, False), (1.0 + 2.375 + 1.06, 5.0, -np.pi / 2.0, True)],
    ],
)
def test_passing_on_a_road_that_points_elsewhere(lab, turn, ahead, left, yaw, passed):
    """On a road through the origin; the EMV is 6.5 m long and 2.1 m wide, the car 4.75 m long."""
    network, along, across = lab.turned_road(turn, length=300.0)
    place, emv = 100.0 * along, (100.0 + ahead) * along + left * across
    poses = np.array([[*emv, turn + yaw, 8.0], [*place, turn + 0.2, 2.0]])
    cars = [lab.Car(1, 0, 100, 8, (0,), AMBULANCE), lab.Car(2, 0, 100, 2, (0,))]
    assert emv_fully_passed(lab.view(network, lab.L2, cars, poses=poses).ego(1), 0) is passed


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


def test_the_line_of_the_escape_search_begins_behind_the_rear_axle(lab):
    view = view_at(lab, lab.straight_road(2), 0, 100, (0,))
    line = reference_line(view.ego(0), 0)
    assert line.curve.points[0] == pytest.approx((95.0, 0.0), abs=1e-6)
    assert line.curve.length_m == pytest.approx(ESCAPE_HORIZON_M + 10.0)


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
