"""States of drivers: draws of civilians, lanes that the EMV needs, and guards on roads that point anywhere."""

from collections import Counter

import numpy as np
import pytest

from siren_ros.simulation.behaviour.civilians.pull_over import edge_offset_m, emv_waits_behind
from siren_ros.simulation.behaviour.civilians.yield_manager import EmvRoad, region_members, way_from_emv_m
from siren_ros.simulation.behaviour.driving import lane_change
from siren_ros.simulation.behaviour.driving.driver_states import (
    Compliance,
    EmvUnit,
    EmvView,
    RoutePlan,
    best_lane,
    draw_driver,
    emv_fully_passed,
    plan_route,
    present_lane,
    release_reason,
    strategic_side,
)
from siren_ros.simulation.behaviour.driving.lane_path import path_on_lanes
from siren_ros.simulation.behaviour.driving.navigator import NavigatorState
from siren_ros.simulation.behaviour.driving.speed_mechanisms import (
    ESCAPE_HORIZON_M,
    anticipated_limit,
    free_way,
    passage_limit,
)
from siren_ros.simulation.behaviour.driving.tracked_path import LaneEnd
from siren_ros.simulation.behaviour.emv.controller import (
    blocker_of,
    follow_route,
    in_the_way,
    reference_line,
    road_space,
    search_gap,
)
from siren_ros.simulation.behaviour.emv.rescue_corridor import braking_ahead, corridor_offsets, corridor_path
from siren_ros.simulation.roads.road_network import NO_LANE
from siren_ros.simulation.scenario.paper import ControlConstants
from siren_ros.simulation.scenario.presets import load_preset
from siren_ros.simulation.world.actors import ActorClass, Owner


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


@pytest.mark.parametrize(("ahead", "passed"), [(6.62, False), (6.63, True), (-30.0, False)])
def test_passed_when_the_rear_is_a_metre_ahead_of_the_front(lab, ahead, passed):
    """Half of 6.5 m and half of 4.75 m and 1 m make 6.625 m between the centres."""
    view = lab.view(
        lab.straight_road(), lab.L2, [lab.Car(1, 0, 100 + ahead, 8, (0,), AMBULANCE), lab.Car(2, 1, 100, 2, (0,))]
    )
    assert emv_fully_passed(view.ego(1), 0) is passed


def test_passing_is_measured_along_the_civilians_lane(lab, straight):
    cars = [lab.Car(1, 0, 107, 8, (0,), AMBULANCE), lab.Car(2, 1, 100, 2, (0,))]
    view = lab.view(straight, lab.L2, cars, poses=np.array([[107.0, 0.0, 0.0, 8.0], [100.0, 3.3, 0.5, 2.0]]))
    assert emv_fully_passed(view.ego(1), 0)


@pytest.mark.parametrize("turn", np.radians([30.0, 60.0, 140.0, -100.0]))
@pytest.mark.parametrize(
    ("ahead", "left", "yaw", "passed"),
    [
        *[(6.62, 3.3, 0.0, False), (6.63, 3.3, 0.0, True), (6.63, -3.3, 0.0, True)],
        *[(0.0, 8.0, 0.0, False), (-6.7, 0.0, 0.0, False), (1.0 + 2.375 + 1.04, 5.0, np.pi / 2.0, False)],
        (1.0 + 2.375 + 1.06, 5.0, -np.pi / 2.0, True),
    ],
)
def test_passing_on_a_road_that_points_elsewhere(lab, turn, ahead, left, yaw, passed):
    """On a road through the origin; the EMV is 6.5 m long and 2.1 m wide, the car 4.75 m long."""
    network, along, across = lab.turned_road(turn, length=300.0)
    place, emv = 100.0 * along, (100.0 + ahead) * along + left * across
    poses = np.array([[*emv, turn + yaw, 8.0], [*place, turn + 0.2, 2.0]])
    cars = [lab.Car(1, 0, 100, 8, (0,), AMBULANCE), lab.Car(2, 0, 100, 2, (0,))]
    assert emv_fully_passed(lab.view(network, lab.L2, cars, poses=poses).ego(1), 0) is passed


@pytest.mark.parametrize(
    ("passed", "in_region", "reason"),
    [(False, True, ""), (True, True, "emv_passed"), (True, False, "emv_passed"), (False, False, "emv_gone")],
)
def test_released_when_the_emv_has_passed_or_is_gone(passed, in_region, reason):
    assert release_reason(EmvView(0, passed, in_region, on_path=True, on_road=True)) == reason


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


TURNS = np.radians([35.0, 125.0, -100.0])
CARS = [
    # id, lane, s, left, turned, speed
    (1, 0, 100.0, 0.3, 0.03, 6.0),
    (2, 0, 125.0, -0.6, 0.05, 3.0),
    (3, 1, 122.0, 0.9, -0.08, 0.0),
    (4, 1, 80.0, -0.2, 0.1, 9.0),
    (5, 0, 140.0, 0.4, -0.1, 0.2),
]


def view_on_turned_road(lab, turn):
    network, along, across = lab.turned_road(turn, length=300.0)
    poses = np.array(
        [[*(s * along + (3.3 * lane + left) * across), turn + yaw, speed] for _, lane, s, left, yaw, speed in CARS]
    )
    cars = [
        lab.Car(number, lane, s, speed, (0,), ActorClass.AMBULANCE if number == 1 else ActorClass.SEDAN)
        for number, lane, s, _, _, speed in CARS
    ]
    traffic = lab.traffic_of(network, cars, poses=poses, owners=dict.fromkeys((2, 3, 5), int(Owner.ROS)))
    return lab.view_of(lab.world_of(network, lab.L3), traffic), along, across


def numbers(lab, turn):
    """By name; places along and across the road."""
    view, along, across = view_on_turned_road(lab, turn)
    unit = follow_route(EmvUnit(1), view.ego(0))[0]
    reference = path_on_lanes(view.world.network, (0,), LaneEnd.HORIZON, 98.0, 80.0)
    s = np.linspace(2.0, 78.0, 77)
    path = search_gap(reference_line(view.ego(0), 0), view.ego(0))
    corridor = corridor_path(EmvUnit(1, corridor=True), view.ego(0)).navigator.path
    query = lane_change.LaneChangeQuery(view.ego(4), 0, 1, 5.0, civilian=True)
    change = lane_change.lane_change_path(query, lane_change.assess(query), stop_at_end=True).curve.points
    road = EmvRoad.ahead_of(view.ego(0), None)
    escaping = EmvUnit(1, unit.navigator, gap_escape_active=True)
    return {
        "anticipated": anticipated_limit(unit, view.ego(0)).speed_mps,
        "corridor": corridor_offsets(reference, s, view.ego(0))[::8],
        "corridor path": (corridor.curve.points @ across)[::6],
        "braking ahead": braking_ahead(unit, view.ego(0)),
        "escape": (path.left_m[-1], path.length_m, path.clearance_m),
        "free way": (free_way(unit, view.ego(0)).free_m, free_way(escaping, view.ego(0)).free_m),
        "passage": passage_limit(escaping, view.ego(0)).speed_mps,
        "in the way": [in_the_way(view.ego(0), row, 0) for row in range(1, 5)],
        "blocker": blocker_of(escaping, view.ego(0)),
        "gaps": [
            (gaps.front_m, gaps.rear_m, gaps.front_id)
            for gaps in (lane_change.gaps_in_lane(view.ego(row), lane) for row in range(5) for lane in range(2))
        ],
        "offsets": [lane_change.offset_in_lane(view.ego(row), lane) for row in range(5) for lane in range(2)],
        "entered": [lane_change.entered_lane(view.ego(row), lane) for row in range(5) for lane in range(2)],
        "way": way_from_emv_m(view, 0, road.road_start_m),
        "members": region_members(view.seen, 0, np.empty(0, np.uint32), ControlConstants(region_enter_m=30.0)),
        "waits": [emv_waits_behind(view.ego(row), 2) for row in range(5)],
        "passed": [emv_fully_passed(view.ego(row), 0) for row in range(1, 5)],
        "edges": [edge_offset_m(view.ego(row), row % 2, side) for row in range(1, 5) for side in (1, -1)],
        "change": (query.length_m, change[::6] @ along, change[::6] @ across),
    }


@pytest.fixture(scope="module")
def cache():
    return {}


@pytest.mark.parametrize("turn", TURNS)
def test_a_turned_scene_has_the_same_numbers(lab, cache, turn):
    plain = cache.setdefault("plain", numbers(lab, 0.0))
    assert plain["braking ahead"]
    assert plain["escape"][1] > 8.0
    assert np.ptp(plain["corridor"]) > 0.1
    other = numbers(lab, turn)
    for name, value in plain.items():
        flat, turned = (
            np.hstack([np.ravel(np.asarray(part, dtype=float)) for part in _parts(v)]) for v in (value, other[name])
        )
        np.testing.assert_allclose(turned, flat, atol=0.08, err_msg=name)


def _parts(value):
    return value if isinstance(value, list | tuple) else [value]
