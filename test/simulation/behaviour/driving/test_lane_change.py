import math
from dataclasses import replace

import numpy as np
import pytest

from siren_ros.simulation.behaviour.driving.lane_change import (
    LaneChangeQuery,
    LaneGaps,
    Refusal,
    assess,
    entered_lane,
    gaps_in_lane,
    lane_change_path,
    refusal_of_gaps,
)
from siren_ros.simulation.behaviour.paths.lane_path import LanePath
from siren_ros.simulation.behaviour.paths.tracked_path import PEAK_CURVATURE, blend_length_m
from siren_ros.simulation.roads.road_network import LaneKind
from siren_ros.simulation.scenario.driver_parameters import LaneChangeConfig
from siren_ros.simulation.world.actors import ActorClass

CONFIG = LaneChangeConfig()


def query(view, row=0, lane=0, side=1, civilian=True):
    return LaneChangeQuery(view.ego(row), lane, side, 2.8, civilian)


def test_gaps_are_from_bumper_to_bumper(lab):
    cars = [lab.Car(1, 0, 100, 8, (0,)), lab.Car(2, 1, 120, 5, (0,)), lab.Car(3, 1, 70, 9, (0,))]
    gaps = gaps_in_lane(lab.view(lab.straight_road(), lab.L2, cars).ego(0), 1)
    assert (gaps.front_m, gaps.rear_m) == (pytest.approx(20.0 - 4.75), pytest.approx(30.0 - 4.75))
    assert (gaps.front_mps, gaps.rear_mps, gaps.front_id) == (5.0, 9.0, 2)


def test_empty_lane_has_infinite_gaps(lab):
    view = lab.view(lab.straight_road(), lab.L2, [lab.Car(1, 0, 100, 8, (0,))])
    assert gaps_in_lane(view.ego(0), 1).front_m == math.inf
    assert isinstance(assess(query(view)), LanePath)


def test_refusals_by_gap():
    assert refusal_of_gaps(LaneGaps(math.inf, 0.0, math.inf, 0.0), 8.0, 2.8, CONFIG) is None
    assert refusal_of_gaps(LaneGaps(-1.0, 5.0, math.inf, 0.0), 8.0, 2.8, CONFIG) is Refusal.BESIDE
    assert refusal_of_gaps(LaneGaps(3.9, 5.0, math.inf, 0.0), 8.0, 2.8, CONFIG) is Refusal.GAP_FRONT
    assert refusal_of_gaps(LaneGaps(4.1, 5.0, math.inf, 0.0), 8.0, 2.8, CONFIG) is None
    assert refusal_of_gaps(LaneGaps(math.inf, 0.0, 2.1, 5.0), 5.0, 5.0, CONFIG) is None
    assert refusal_of_gaps(LaneGaps(math.inf, 0.0, 11.0, 12.0), 5.0, 5.0, CONFIG) is Refusal.GAP_REAR
    assert refusal_of_gaps(LaneGaps(math.inf, 0.0, 12.0, 12.0), 5.0, 5.0, CONFIG) is None


def test_rear_gap_outlasts_both_vehicles_braking():
    """The vehicles' motion, integrated, against the closed form."""
    for speed, rear, target in ((7.0, 8.0, 2.8), (9.0, 6.0, 2.8), (5.0, 12.0, 13.9)):
        gap = next(
            g
            for g in np.arange(0.1, 40.0, 0.02)
            if refusal_of_gaps(LaneGaps(math.inf, 0.0, float(g), rear), speed, target, CONFIG) is None
        )
        distance, v, w, dt = gap, speed, rear, 0.001
        for k in range(12000):
            distance += (v - w) * dt
            v = max(min(speed, target), v - CONFIG.own_brake_mps2 * dt)
            if k * dt >= CONFIG.rear_time_s:
                w = max(min(speed, target), w - CONFIG.brake_mps2 * dt) if w > min(speed, target) else w
        assert distance >= CONFIG.rear_gap_m - 0.05


def test_vehicle_beside_refuses(lab):
    view = lab.view(lab.straight_road(), lab.L2, [lab.Car(1, 0, 100, 8, (0,)), lab.Car(2, 1, 102, 8, (0,))])
    assert assess(query(view)) is Refusal.BESIDE


def test_no_lane_and_no_shoulder_for_civilians(lab):
    view = lab.view(lab.straight_road(2, shoulder=True), lab.L2, [lab.Car(1, 1, 100, 8, (0,))])
    assert assess(query(view, lane=1, side=1)) is Refusal.NO_LANE
    assert assess(query(view, lane=1, side=-1)) is Refusal.NO_LANE
    assert isinstance(assess(query(view, lane=1, side=-1, civilian=False)), LanePath)


def test_no_lane_change_on_or_right_before_a_junction(lab, junction):
    view = lab.view(junction, lab.L2, [lab.Car(1, 0, 140, 8, (0, 2))])
    assert assess(query(view)) is Refusal.NO_ROOM
    view = lab.view(junction, lab.L2, [lab.Car(1, 2, 10, 8, (0, 2))])
    assert assess(query(view, lane=2)) is Refusal.JUNCTION


def test_on_a_junction_that_nobody_crosses_lanes_are_changed_as_on_the_road(lab):
    road = lab.RoadBuilder().edge([[0, 0], [60, 0]], 2, ("W", "J"))
    road.edge([[60, 0], [90, 0]], 2, ("J", "J"), internal=True)
    road.edge([[90, 0], [400, 0]], 2, ("J", "E"))
    for position in (0, 1):
        road.connect(position, 4 + position, via=(2 + position,))
    for civilian in (True, False):
        view = lab.view(road.built(), lab.L2, [lab.Car(1, 2, 5, 8, (0, 2))])
        verdict = assess(query(view, lane=2, civilian=civilian))
        assert isinstance(verdict, LanePath)
        assert verdict.lanes[:2] == (3, 5)


def test_lane_that_leads_astray_needs_room_to_come_back(lab, junction):
    assert assess(query(lab.view(junction, lab.L2, [lab.Car(1, 0, 90, 8, (0, 4))]))) is Refusal.ASTRAY
    assert isinstance(assess(query(lab.view(junction, lab.L2, [lab.Car(1, 0, 30, 8, (0, 4))]))), LanePath)


def test_path_starts_here_and_ends_in_the_target_lane(lab):
    asked = query(lab.view(lab.straight_road(), lab.L2, [lab.Car(1, 0, 100, 8, (0,))]))
    path = lane_change_path(asked, assess(asked), stop_at_end=True)
    np.testing.assert_allclose(path.curve.points[0], [100.0, 0.0], atol=1e-6)
    assert (path.curve.points[-1, 1], path.lane_at(0.0)) == (pytest.approx(3.3, abs=1e-6), 1)


@pytest.mark.parametrize(("left", "expected"), [(0.0, True), (0.6, True), (1.2, False), (-1.2, False)])
def test_entered_needs_the_whole_footprint(lab, left, expected):
    view = lab.view(lab.straight_road(), lab.L2, [lab.Car(1, 1, 100, 8, (0,), left=left)])
    assert entered_lane(view.ego(0), 1) is expected


@pytest.mark.parametrize(("degrees", "expected"), [(7.5, True), (8.5, False), (-8.5, False)])
def test_entered_needs_a_heading_within_eight_degrees(lab, straight, degrees, expected):
    poses = np.array([[100.0, 3.3, np.radians(degrees), 5.0]])
    view = lab.view(straight, lab.L2, [lab.Car(1, 1, 100, 5, (0,), ActorClass.HATCHBACK)], poses=poses)
    assert entered_lane(view.ego(0), 1) is expected


@pytest.mark.parametrize(
    ("speed", "rear", "target"),
    [(7.0, 9.0, 2.8), (9.0, 12.0, 13.9), (5.0, 12.0, 5.0), (8.0, 4.0, 2.8), (12.0, 12.5, 3.0)],
)
def test_the_gap_behind_is_that_of_both_who_brake(speed, rear, target):
    """v·t + v²/2b of the one behind, less what the own slowing takes; 2 m at least."""
    slowest = min(speed, target)
    closing = max(rear - slowest, 0.0)
    way = closing * CONFIG.rear_time_s + closing**2 / (2.0 * CONFIG.brake_mps2)
    way -= (speed - slowest) ** 2 / (2.0 * CONFIG.own_brake_mps2)
    gap = CONFIG.rear_gap_m + max(way, 0.0)
    for more, refusal in ((-0.01, Refusal.GAP_REAR), (0.01, None)):
        assert refusal_of_gaps(LaneGaps(math.inf, 0.0, gap + more, rear), speed, target, CONFIG) is refusal


@pytest.mark.parametrize(("speed", "lead"), [(8.0, 3.0), (12.0, 0.0), (5.0, 9.0), (6.0, 6.0)])
def test_the_gap_ahead_is_that_of_one_who_brakes_after_a_moment(speed, lead):
    closing = max(speed - lead, 0.0)
    gap = CONFIG.front_gap_m + closing * CONFIG.front_time_s + closing**2 / (2.0 * CONFIG.front_brake_mps2)
    for more, refusal in ((-0.01, Refusal.GAP_FRONT), (0.01, None)):
        assert refusal_of_gaps(LaneGaps(gap + more, lead, math.inf, 0.0), speed, speed, CONFIG) is refusal


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize("degrees", [0.0, 7.5, -7.5])
def test_the_whole_footprint_is_in_the_lane_up_to_the_tolerance(lab, side, degrees):
    """Half a lane less half of the turned body, and 15 cm over the edge."""
    network, kind = lab.straight_road(), ActorClass.SEDAN
    vehicle, turned = lab.vehicles[kind], np.radians(degrees)
    half = 0.5 * (vehicle.width_m * np.cos(turned) + vehicle.length_m * abs(np.sin(turned)))
    most = max(1.65 - half, 0.1) + 0.15
    for more, inside in ((-0.005, True), (0.005, False)):
        poses = np.array([[100.0, 3.3 + side * (most + more), turned, 5.0]])
        view = lab.view(network, lab.L2, [lab.Car(1, 1, 100, 5, (0,))], poses=poses)
        assert entered_lane(view.ego(0), 1) is inside


@pytest.mark.parametrize("turn", np.radians([0.0, 50.0, -140.0]))
@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize("turned", [0.0, 0.4, -0.4])
def test_who_is_in_a_lane_with_a_part_of_its_body_counts_as_far_as_the_own_body_reaches(lab, turn, side, turned):
    """A body's half width and 10 cm from the middle of the lane; bodies across the lane do not count."""
    network, along, across = lab.turned_road(turn, lanes=1)
    sedan = lab.vehicles[ActorClass.SEDAN]
    reach = 0.5 * (sedan.width_m + sedan.width_m * np.cos(turned) + sedan.length_m * abs(np.sin(turned))) + 0.1
    cars = [lab.Car(1, 0, 100, 5, (0,)), lab.Car(2, 0, 120, 3, (0,))]
    for more, counts in ((-0.02, True), (0.02, False)):
        place = 120.0 * along + side * (reach + more) * across
        poses = np.array([[*(100.0 * along), turn, 5.0], [*place, turn + turned, 3.0]])
        view = lab.view(network, lab.L2, cars, poses=poses)
        assert gaps_in_lane(view.ego(0), 0).front_m == (pytest.approx(20.0 - sedan.length_m) if counts else math.inf)


@pytest.mark.parametrize("kind", [ActorClass.HATCHBACK, ActorClass.BUS, ActorClass.FIRE_TRUCK])
@pytest.mark.parametrize("civilian", [True, False])
@pytest.mark.parametrize(
    ("speed", "target"), [(0.0, 2.8), (1.0, 2.8), (4.0, 2.8), (8.0, 13.9), (13.0, 2.8), (13.0, 16.0)]
)
def test_a_change_is_as_long_as_time_steering_and_lock_ask(lab, kind, civilian, speed, target):
    """On average the vehicle is as fast as it wants to be, gains 2.5 m/s at most, and loses a quarter at most."""
    view = lab.view(lab.straight_road(), lab.L2, [lab.Car(1, 0, 100, speed, (0,), kind)])
    asked = replace(query(view, civilian=civilian), target_mps=target)
    config = view.world.config.civilian_driver.lane_change if civilian else view.world.config.emv_driver.lane_change
    vehicle = lab.vehicles[kind]
    mean = max(min(target, speed + 2.5), 0.75 * speed)
    lock = np.tan(0.7 * vehicle.max_steer_rad) / vehicle.wheelbase_m
    expected = max(
        config.length_min_m,
        np.sqrt(PEAK_CURVATURE * 3.3 / lock),
        config.duration_s * speed,
        blend_length_m(3.3, mean, config.duration_s, config.length_min_m, view.ego(0).navigator_config),
    )
    assert asked.length_m == pytest.approx(expected)


@pytest.mark.parametrize("civilian", [True, False])
@pytest.mark.parametrize(("civilians", "emergency"), [(True, True), (False, True), (True, False), (False, False)])
@pytest.mark.parametrize("kind", [LaneKind.DRIVING, LaneKind.SHOULDER, LaneKind.SIDEWALK])
def test_a_lane_is_open_to_those_who_may_use_it_and_to_civilians_where_it_is_a_driving_lane(
    lab, civilian, civilians, emergency, kind
):
    network = lab.straight_road()
    lanes = list(network.lanes)
    lanes[1] = replace(lanes[1], kind=kind, civilian_allowed=civilians, emergency_allowed=emergency)
    network = replace(network, lanes=tuple(lanes))
    view = lab.view(network, lab.L2, [lab.Car(1, 0, 100, 8, (0,))])
    usable = (civilians and kind is LaneKind.DRIVING) if civilian else emergency
    verdict = assess(query(view, civilian=civilian))
    if civilian or usable:
        assert (verdict is not Refusal.NO_LANE) is usable
