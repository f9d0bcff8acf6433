"""Forced lane changes: gaps, when the EMV wants another lane and why, and what a lane change leaves behind."""

import math
from dataclasses import replace

import numpy as np
import pytest

from siren_ros.simulation.behaviour.driving.driver_states import EmvUnit, LateralRequest, Refusal, RoutePlan, advice_of
from siren_ros.simulation.behaviour.driving.lane_change import (
    ROUTE,
    SUMO,
    LaneChangeQuery,
    LaneGaps,
    assess,
    cancel_lane_change,
    complete_lane_change,
    entered_lane,
    forced_lane_change,
    free_side,
    gaps_in_lane,
    lane_change_path,
    lateral_intent,
    refusal_of_gaps,
)
from siren_ros.simulation.behaviour.driving.tracked_path import PEAK_CURVATURE, LaneEnd, LanePath, blend_length_m
from siren_ros.simulation.behaviour.emv.controller import follow_route
from siren_ros.simulation.roads.road_network import LaneKind
from siren_ros.simulation.scenario.driver_parameters import LaneChangeConfig
from siren_ros.simulation.world.actors import ActorClass

CONFIG = LaneChangeConfig()


def query(view, row=0, lane=0, side=1, civilian=True, *, to_route=False):
    return LaneChangeQuery(view.ego(row), lane, side, 2.8, civilian, to_route)


def test_gaps_are_from_bumper_to_bumper(lab):
    cars = [lab.Car(1, 0, 100, 8, (0,)), lab.Car(2, 1, 120, 5, (0,)), lab.Car(3, 1, 70, 9, (0,))]
    gaps = gaps_in_lane(lab.view(lab.straight_road(), lab.L2, cars).ego(0), 1)
    assert (gaps.front_m, gaps.rear_m) == (pytest.approx(20.0 - 4.75), pytest.approx(30.0 - 4.75))
    assert (gaps.front_mps, gaps.rear_mps, gaps.front_id) == (5.0, 9.0, 2)


def test_empty_lane_has_infinite_gaps(lab):
    view = lab.view(lab.straight_road(), lab.L2, [lab.Car(1, 0, 100, 8, (0,))])
    assert gaps_in_lane(view.ego(0), 1).front_m == math.inf
    assert isinstance(assess(query(view)), LanePath)
    beside = lab.view(lab.straight_road(), lab.L2, [lab.Car(1, 0, 100, 8, (0,)), lab.Car(2, 1, 102, 8, (0,))])
    assert assess(query(beside)) is Refusal.BESIDE


def test_refusals_by_gap():
    assert refusal_of_gaps(LaneGaps(math.inf, 0.0, math.inf, 0.0), 8.0, 2.8, CONFIG) is None
    assert refusal_of_gaps(LaneGaps(-1.0, 5.0, math.inf, 0.0), 8.0, 2.8, CONFIG) is Refusal.BESIDE
    assert refusal_of_gaps(LaneGaps(math.inf, 0.0, 2.1, 5.0), 5.0, 5.0, CONFIG) is None


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
    towards = query(lab.view(junction, lab.L2, [lab.Car(1, 0, 90, 8, (0, 4))]), to_route=True)
    assert isinstance(assess(towards), LanePath), "the first of several changes towards the route"


def test_path_starts_here_and_ends_in_the_target_lane(lab):
    asked = query(lab.view(lab.straight_road(), lab.L2, [lab.Car(1, 0, 100, 8, (0,))]))
    path = lane_change_path(asked, assess(asked), stop_at_end=True)
    np.testing.assert_allclose(path.curve.points[0], [100.0, 0.0], atol=1e-6)
    assert (path.curve.points[-1, 1], path.lane_at(0.0)) == (pytest.approx(3.3, abs=1e-6), 1)


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


AMBULANCE, SEDAN = ActorClass.AMBULANCE, ActorClass.SEDAN
PLAN = RoutePlan((0,), LaneEnd.HORIZON, 0)


def view_at(lab, *others, lane=1, network=None, s=100.0, speed=8.0, route=(0,), step=100, advice=None):
    network = network or lab.straight_road(3, shoulder=True)
    cars = [lab.Car(1, lane, s, speed, route, AMBULANCE), *others]
    return lab.view(network, lab.L1, cars, step=step, advice=advice)


def ahead(lab, gap, speed, lane=1, actor_id=2):
    """A car with so much free way between the bumpers."""
    half = 0.5 * (lab.vehicles[AMBULANCE].length_m + lab.vehicles[SEDAN].length_m)
    return lab.Car(actor_id, lane, 100.0 + half + gap, speed, (0,))


SHOULDER = (-1, "shoulder")


def shoulder_is_faster(unit, ego):
    return free_side(unit, ego) == SHOULDER


@pytest.mark.parametrize(("gap", "speed", "faster"), [(49.9, 2.9, True), (50.1, 2.9, False), (49.9, 3.1, False)])
def test_slow_traffic_within_50_m_makes_the_shoulder_faster(lab, gap, speed, faster):
    assert shoulder_is_faster(EmvUnit(1), view_at(lab, ahead(lab, gap, speed)).ego(0)) is faster


@pytest.mark.parametrize(("gain", "faster"), [(19.9, False), (20.1, True)])
def test_the_shoulder_has_to_gain_20_m(lab, gain, faster):
    others = ahead(lab, 25.0, 1.0), ahead(lab, 25.0 + gain, 1.0, lane=0, actor_id=3)
    assert shoulder_is_faster(EmvUnit(1), view_at(lab, *others).ego(0)) is faster


@pytest.mark.parametrize(("lane", "faster"), [(0, False), (1, True), (2, False)])
def test_only_from_the_lane_next_to_the_shoulder(lab, lane, faster):
    """The EMV on the shoulder itself, next to it, and one lane farther."""
    view = view_at(lab, ahead(lab, 25.0, 1.0, lane=lane), lane=lane)
    assert shoulder_is_faster(EmvUnit(1), view.ego(0)) is faster
    plain = view_at(lab, ahead(lab, 25.0, 1.0, lane=1), lane=1, network=lab.straight_road(3))
    assert not shoulder_is_faster(EmvUnit(1), plain.ego(0))


@pytest.mark.parametrize(
    ("lane", "others", "side"),
    [(0, (), 1), (2, (), -1), (1, (), -1), (1, (0,), 1), (1, (0, 2), 0), (0, (1,), 0)],
    ids=["left", "right", "right before left", "right is taken", "both are taken", "left is taken"],
)
def test_a_free_lane_leads_past_slow_traffic(lab, lane, others, side):
    """Standing traffic 25 m ahead in the EMV's lane, and 30 m ahead in others."""
    taken = [ahead(lab, 30.0, 0.0, lane=other, actor_id=3 + other) for other in others]
    view = view_at(lab, ahead(lab, 25.0, 0.0, lane=lane), *taken, lane=lane, network=lab.straight_road(3))
    assert free_side(EmvUnit(1), view.ego(0)) == ((side, "free_lane") if side else (0, ""))


@pytest.mark.parametrize(("head_m", "side"), [(31.5, 1), (28.5, 0)])
def test_a_free_lane_that_leads_astray_has_to_lead_30_m_beyond_the_queue(lab, head_m, side):
    """Its left lane is for those who turn left; before the line is room to come back, or not."""
    road = lab.RoadBuilder().edge([[0.0, 0.0], [300.0, 0.0]], 2, ("W", "J"))
    road.edge([[310.0, 0.0], [510.0, 0.0]], 1, ("J", "E"))
    road.connect(0, 2)
    tail = lab.Car(2, 0, 240.0, 0.0, (0, 1))
    view = view_at(
        lab, tail, before_line(lab, head_m, 0.0, lane=0), lane=0, network=road.built(), s=220.0, route=(0, 1)
    )
    assert free_side(EmvUnit(1), view.ego(0))[0] == side


def ending_shoulder(lab, leads_on=False):
    """An approach of 300 m whose shoulder ends at the line, unless it leads on."""
    road = lab.RoadBuilder().edge([[0.0, 0.0], [300.0, 0.0]], 3, ("W", "J"), shoulder=True)
    road.edge([[310.0, 0.0], [510.0, 0.0]], 3, ("J", "E"), shoulder=True)
    for lane in range(0 if leads_on else 1, 3):
        road.connect(lane, 3 + lane)
    return road.built()


def before_line(lab, front_m, speed, lane=1, actor_id=9):
    """A car with its front so far before the line."""
    return lab.Car(actor_id, lane, 300.0 - front_m - 0.5 * lab.vehicles[SEDAN].length_m, speed, (0, 1))


@pytest.mark.parametrize(
    ("front_m", "speed", "lane", "faster"),
    [(28.5, 0.0, 1, False), (31.5, 0.0, 1, True), (5.0, 2.9, 1, False), (5.0, 3.1, 1, True), (5.0, 0.0, 2, True)],
    ids=["no way back", "way back", "rolls", "drives", "in the other lane"],
)
def test_a_shoulder_that_ends_has_to_lead_30_m_beyond_the_queue(lab, front_m, speed, lane, faster):
    """The queue's tail is 10 m ahead. Its head decides, in the EMV's own lane."""
    tail = replace(ahead(lab, 10.0, 1.0), s=ahead(lab, 10.0, 1.0).s + 120.0)
    cars = tail, before_line(lab, front_m, speed, lane)
    for leads_on in (False, True):
        view = view_at(lab, *cars, network=ending_shoulder(lab, leads_on), s=220.0, route=(0, 1))
        assert shoulder_is_faster(EmvUnit(1), view.ego(0)) is (faster or leads_on)


def test_the_route_comes_before_the_shoulder_and_this_before_sumos_wish(lab):
    slow = ahead(lab, 25.0, 1.0)
    wish = {"lane_change_intent": 1}
    assert lateral_intent(EmvUnit(1), view_at(lab, slow, advice=wish).ego(0)) == (0, SUMO), "before the first plan"
    planned = EmvUnit(1, plan=PLAN)
    assert lateral_intent(planned, view_at(lab, slow, advice=wish).ego(0)) == SHOULDER
    assert lateral_intent(planned, view_at(lab, advice=wish).ego(0)) == (1, SUMO)
    assert lateral_intent(planned, view_at(lab).ego(0)) == (0, SUMO)
    view = view_at(lab, advice=wish)
    unadvised = replace(view, traffic=replace(view.traffic, emvs=()))
    assert lateral_intent(planned, unadvised.ego(0)) == (0, SUMO), "SUMO says nothing of this EMV"


@pytest.mark.parametrize(
    ("turned_deg", "wants"),
    [(6.0, 0), (-6.0, 1), (0.0, 1), (1.0, 1)],
    ids=["to that side", "to the other side", "straight on", "keeps its lane"],
)
def test_the_emv_does_not_follow_a_vehicle_that_makes_way_into_its_new_lane(lab, turned_deg, wants):
    network = lab.straight_road(3)
    cars = [
        lab.Car(1, 1, 100.0, 8.0, (0,), AMBULANCE),
        lab.Car(2, 1, 125.0, 5.0, (0,)),
        lab.Car(3, 1, 150.0, 0.0, (0,)),
    ]
    places = [network.lanes[1].centre.at(car.s) for car in cars]
    yaw_rad = np.radians([0.0, turned_deg, 0.0])
    poses = np.array([(*place, yaw, car.speed) for place, yaw, car in zip(places, yaw_rad, cars, strict=True)])
    view = lab.view(network, lab.L1, cars, step=100, poses=poses, advice={"lane_change_intent": 1})
    unit, _ = follow_route(EmvUnit(1), view.ego(0))
    assert lateral_intent(unit, view.ego(0)) == (wants, SUMO)


@pytest.mark.parametrize(
    ("there_m", "here_m", "wants"),
    [(25.0, 40.0, 0), (40.0, 40.0, 0), (40.0, 25.0, 1), (25.0, None, 0), (None, 25.0, 1)],
)
def test_sumos_wish_counts_only_where_the_emv_has_more_room(lab, there_m, here_m, wants):
    places = [(lane, ahead_m) for lane, ahead_m in ((2, there_m), (1, here_m)) if ahead_m is not None]
    cars = [lab.Car(k + 2, lane, 100.0 + ahead_m, 8.0, (0,)) for k, (lane, ahead_m) in enumerate(places)]
    emv = lab.Car(1, 1, 100.0, 8.0, (0,), AMBULANCE)
    view = lab.view(lab.straight_road(3), lab.L1, [emv, *cars], step=100, advice={"lane_change_intent": 1})
    unit, _ = follow_route(EmvUnit(1), view.ego(0))
    assert lateral_intent(unit, view.ego(0)) == (wants, SUMO)


@pytest.mark.parametrize(("left_m", "wants"), [(199.0, True), (201.0, False)])
def test_a_lane_that_leads_astray_is_left_from_200_m_before_its_end(lab, left_m, wants):
    """A long approach whose left lane does not turn right."""
    road = lab.RoadBuilder().edge([[0.0, 0.0], [400.0, 0.0]], 2, ("W", "J"))
    road.edge([[410.0, -10.0], [410.0, -200.0]], 1, ("J", "S"))
    road.connect(0, 2, direction="r")
    view = view_at(lab, lane=1, network=road.built(), s=300.0, route=(0, 1), advice={"lane_change_intent": 1})
    unit = follow_route(EmvUnit(1), view.ego(0))[0]
    assert unit.plan.end is LaneEnd.ASTRAY
    unit = replace(unit, navigator=replace(unit.navigator, progress_m=unit.navigator.path.length_m - left_m))
    assert lateral_intent(unit, view.ego(0)) == ((-1, ROUTE) if wants else (1, SUMO))


def test_advice_is_the_emvs_own(lab):
    """Two EMVs, each with its wish."""
    network = lab.straight_road(3)
    cars = [lab.Car(1, 1, 100, 8, (0,), AMBULANCE), lab.Car(7, 1, 60, 8, (0,), ActorClass.FIRE_TRUCK)]
    traffic = lab.traffic_of(network, cars)
    first, second = traffic.emvs
    advice = (replace(first, lane_change_intent=-1), replace(second, lane_change_intent=1))
    view = lab.view_of(lab.world_of(network, lab.L1), replace(traffic, emvs=advice))
    assert [lateral_intent(EmvUnit(actor, plan=PLAN), view.ego(row))[0] for row, actor in enumerate((1, 7))] == [-1, 1]
    assert advice_of(view, 3) is None


def test_nothing_of_a_request_is_left_when_the_change_starts(lab):
    view = view_at(lab, network=lab.straight_road(3), advice={"lane_change_intent": 1})
    changing, events = forced_lane_change(follow_route(EmvUnit(1), view.ego(0))[0], view.ego(0))
    assert [event.kind.value for event in events] == ["lane_change_requested", "lane_change_started"]
    assert (changing.change_side, changing.change_step) == (1, 100)
    assert changing.request == LateralRequest()
    assert events[1].detail == {"side": 1, "reason": SUMO, "lane": 2}


@pytest.mark.parametrize("intent", [0, 1])
def test_a_change_starts_only_at_a_step_with_the_intent(lab, intent):
    """One that has paused for 0.25 s is still a request, and waits."""
    view = view_at(lab, network=lab.straight_road(3), advice={"lane_change_intent": intent})
    unit = replace(follow_route(EmvUnit(1), view.ego(0))[0], request=LateralRequest(1, SUMO, 95))
    unit, events = forced_lane_change(unit, view.ego(0))
    assert (unit.change_side, len(events), unit.request.side) == (intent, intent, 1 - intent)


@pytest.mark.parametrize("ended", [complete_lane_change, lambda *what: cancel_lane_change(*what, "corridor")])
def test_who_changes_no_lanes_has_nothing_to_end(lab, ended):
    unit = EmvUnit(1, plan=PLAN)
    assert ended(unit, view_at(lab).ego(0)) == (unit, ())


def test_a_cancelled_change_leaves_no_plan_and_a_completed_one_keeps_it(lab):
    view = view_at(lab, network=lab.straight_road(3))
    unit = replace(follow_route(EmvUnit(1), view.ego(0))[0], change_side=-1)
    cancelled, (event,) = cancel_lane_change(unit, view.ego(0), "corridor")
    assert (cancelled.change_side, cancelled.plan) == (0, None)
    assert event.detail == {"side": -1, "reason": "corridor"}
    completed, (event,) = complete_lane_change(unit, view.ego(0))
    assert (completed.change_side, completed.plan) == (0, unit.plan)
    assert event.detail == {"side": -1, "lane": 1}


@pytest.mark.parametrize("bend", [0.025, -0.025, 0.015, -0.015])
def test_an_emv_that_turns_more_sharply_than_the_target_lane_waits(lab, bend):
    """0.02 per metre is the limit, to either side."""
    view = view_at(lab, network=lab.straight_road(3), advice={"lane_change_intent": 1})
    unit = follow_route(EmvUnit(1), view.ego(0))[0]
    path = unit.navigator.path
    curve = path.curve._replace(curvature_1pm=np.full(len(path.curve.points), bend))
    turning = replace(unit, navigator=replace(unit.navigator, path=replace(path, curve=curve)))
    _, events = forced_lane_change(turning, view.ego(0))
    kind = "lane_change_deferred" if abs(bend) > 0.02 else "lane_change_started"
    assert [event.kind.value for event in events] == ["lane_change_requested", kind]
