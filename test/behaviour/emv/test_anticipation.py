import math
from dataclasses import replace

import numpy as np
import pytest

from siren_ros.behaviour.config import AnticipationConfig
from siren_ros.behaviour.emv.anticipation import anticipated_limit, approach_speed_mps
from siren_ros.behaviour.emv.controller import follow_route
from siren_ros.behaviour.emv.forced_lane_change import ROUTE
from siren_ros.behaviour.emv.unit import EmvUnit, LateralRequest
from siren_ros.world.actors import ActorClass

CONFIG = AnticipationConfig()
HALF = 0.5 * (6.5 + 4.75)


def approach(gap, lead, overlap=2.0, leaving=0.0):
    return float(approach_speed_mps(*(np.array([value]) for value in (gap, lead, overlap, leaving)), CONFIG)[0])


def scene(lab, *others, speed=13.0):
    network = lab.straight_road()
    cars = [lab.Car(1, 0, 100, speed, (0,), ActorClass.AMBULANCE), *others]
    view = lab.view_of(lab.world_of(network, lab.L2), lab.traffic_of(network, cars))
    return follow_route(EmvUnit(1), view, 0)[0], view


def test_stops_gently_behind_a_standing_vehicle():
    """With the headway's distance in hand, the speed is that of a stop at the constant gentle deceleration."""
    brake, headway, standstill = CONFIG.brake_mps2, CONFIG.headway_s, CONFIG.standstill_gap_m
    speed = 8.0
    gap = standstill + speed * headway + speed**2 / (2.0 * brake)
    assert approach(gap, 0.0) == pytest.approx(speed)
    assert approach(standstill, 0.0) == 0.0


def test_follows_at_the_same_speed_after_the_headway():
    assert approach(CONFIG.standstill_gap_m + 7.0 * CONFIG.headway_s, 7.0) == pytest.approx(7.0)


def test_a_vehicle_that_leaves_the_path_is_approached_so_as_to_arrive_when_it_has_left():
    staying, leaving = approach(26.0, 3.0), approach(26.0, 3.0, overlap=1.2, leaving=1.0)
    assert leaving == pytest.approx(3.0 + (26.0 - CONFIG.standstill_gap_m) / (1.2 / CONFIG.leaving_mps))
    assert leaving > staying
    assert approach(26.0, 3.0, overlap=1.2, leaving=0.1) == staying
    assert approach(26.0, 3.0, overlap=9.0, leaving=1.0) == staying
    assert approach(26.0, 3.0, overlap=2.0, leaving=-1.0) == staying


def test_only_vehicles_on_the_path_in_the_same_direction_count(lab):
    assert math.isinf(anticipated_limit(*scene(lab, lab.Car(2, 1, 130, 0, (0,))), 0).speed_mps)
    assert math.isinf(anticipated_limit(*scene(lab, lab.Car(2, 0, 70, 0, (0,))), 0).speed_mps)
    assert anticipated_limit(*scene(lab, lab.Car(2, 0, 130, 0, (0,))), 0).speed_mps < 13.0


def test_slows_down_no_more_than_gently_and_leaves_braking_to_the_collision_handling(lab):
    unit, view = scene(lab, lab.Car(2, 0, 100 + HALF + 7.0, 0, (0,)))
    limit = anticipated_limit(unit, view, 0)
    gain = view.world.config.emv.navigator.speed_gain_1ps
    assert limit.speed_mps == pytest.approx(13.0 - CONFIG.ease_off_mps2 / gain)
    assert limit.brake_mps2 == 0.0


def test_adapts_to_the_lane_that_the_route_needs_before_it_can_change(lab):
    unit, view = scene(lab, lab.Car(2, 1, 100 + HALF + 20.0, 5, (0,)), speed=8.0)
    asked = replace(unit, request=LateralRequest(1, ROUTE, 0))
    assert math.isinf(anticipated_limit(unit, view, 0).speed_mps)
    expected = max(approach(20.0, 5.0), 8.0 - CONFIG.ease_off_mps2 / view.world.config.emv.navigator.speed_gain_1ps)
    assert anticipated_limit(asked, view, 0).speed_mps == pytest.approx(expected)


def test_does_not_saw_behind_one_yielder_after_another(lab):
    """Three vehicles at 20 km/h leave the lane one after the other; the EMV brakes for all of them together once."""
    cars = [lab.Car(1, 0, 60, 12, (0,), ActorClass.AMBULANCE)]
    cars += [lab.Car(2 + i, 0, 96 + 14 * i, 5.5, (0,), desired=5.5) for i in range(3)]
    loop = lab.Loop(lab.world_of(lab.straight_road(2, length=700), lab.L2), cars).run(600)
    speed = np.array([row[1][3] for row in loop.log])
    accel = np.diff(speed) / 0.05
    assert np.percentile(accel, 1) > -2.5
    assert np.percentile(accel, 99) < 2.5
    assert not loop.touching()


@pytest.mark.parametrize("turn", np.radians([0.0, 40.0, -110.0]))
@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize("turned", [0.0, 0.3, -0.3])
def test_a_vehicle_is_in_the_way_up_to_both_half_bodies_and_a_margin_aside(lab, turn, side, turned):
    along, across = np.array([np.cos(turn), np.sin(turn)]), np.array([-np.sin(turn), np.cos(turn)])
    road = lab.RoadBuilder()
    road.edge([[0.0, 0.0], 400.0 * along], 1, ("A", "B"))
    network = road.built()
    sedan, ambulance = lab.vehicles[ActorClass.SEDAN], lab.vehicles[ActorClass.AMBULANCE]
    side_m = 0.5 * (sedan.width_m * np.cos(turned) + sedan.length_m * abs(np.sin(turned)) + ambulance.width_m)
    cars = [lab.Car(1, 0, 100, 13, (0,), ActorClass.AMBULANCE), lab.Car(2, 0, 130, 0, (0,))]
    for more, counts in ((-0.02, True), (0.02, False)):
        left = side * (side_m + CONFIG.side_margin_m + more)
        poses = np.array([[*(100.0 * along), turn, 13.0], [*(130.0 * along + left * across), turn + turned, 0.0]])
        view = lab.view_of(lab.world_of(network, lab.L2), lab.traffic_of(network, cars, poses=poses))
        limit = anticipated_limit(follow_route(EmvUnit(1), view, 0)[0], view, 0)
        assert math.isfinite(limit.speed_mps) is counts


def test_the_gap_is_between_the_bumpers_also_of_a_vehicle_at_an_angle(lab):
    """The speed is that of the formula, unless easing off is harder than the EMV does for anticipation alone."""
    network = lab.straight_road()
    sedan = lab.vehicles[ActorClass.SEDAN]
    cars = [lab.Car(1, 0, 100, 6, (0,), ActorClass.AMBULANCE), lab.Car(2, 0, 130, 2, (0,))]
    for turned in (0.0, 0.3, -0.3):
        poses = np.array([[100.0, 0.0, 0.0, 6.0], [130.0, 0.0, turned, 2.0]])
        view = lab.view_of(lab.world_of(network, lab.L2), lab.traffic_of(network, cars, poses=poses))
        reach = 0.5 * (sedan.length_m * np.cos(turned) + sedan.width_m * abs(np.sin(turned)))
        gap = 30.0 - reach - 0.5 * lab.vehicles[ActorClass.AMBULANCE].length_m
        limit = anticipated_limit(follow_route(EmvUnit(1), view, 0)[0], view, 0)
        assert limit.speed_mps == pytest.approx(approach(gap, 2.0 * np.cos(turned)), rel=1e-4)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_who_turns_away_from_the_path_leaves_it_to_either_side(lab, side):
    """A car that stands 0.5 m aside and points away leaves; one that points back to the path stays."""
    network = lab.straight_road()
    cars = [lab.Car(1, 0, 100, 3, (0,), ActorClass.AMBULANCE), lab.Car(2, 0, 130, 3, (0,))]
    found = {}
    for turned in (0.3, -0.3):
        poses = np.array([[100.0, 0.0, 0.0, 3.0], [130.0, 0.5 * side, side * turned, 3.0]])
        view = lab.view_of(lab.world_of(network, lab.L2), lab.traffic_of(network, cars, poses=poses))
        found[turned] = anticipated_limit(follow_route(EmvUnit(1), view, 0)[0], view, 0).speed_mps
    sedan, ambulance = lab.vehicles[ActorClass.SEDAN], lab.vehicles[ActorClass.AMBULANCE]
    cos, sin = np.cos(0.3), np.sin(0.3)
    gap = 30.0 - 0.5 * (sedan.length_m * cos + sedan.width_m * sin) - 0.5 * ambulance.length_m
    inside = 0.5 * (sedan.length_m * sin + sedan.width_m * cos + ambulance.width_m) + CONFIG.side_margin_m
    for turned, leaving in ((0.3, 3.0 * sin), (-0.3, -3.0 * sin)):
        assert found[turned] == pytest.approx(approach(gap, 3.0 * cos, inside - 0.5, leaving), rel=1e-4)
    assert found[0.3] > found[-0.3] + 0.5
