"""When the EMV wants another lane and why; what a lane change leaves behind when it ends."""

from dataclasses import replace

import numpy as np
import pytest

from siren_ros.simulation.behaviour.driving.emv_unit import EmvUnit, LateralRequest, RoutePlan, advice_of
from siren_ros.simulation.behaviour.emv.controller import follow_route
from siren_ros.simulation.behaviour.emv.forced_lane_change import (
    ROUTE,
    SUMO,
    cancel_lane_change,
    complete_lane_change,
    forced_lane_change,
    free_side,
    lateral_intent,
)
from siren_ros.simulation.behaviour.paths.lane_path import LaneEnd
from siren_ros.simulation.world.actors import ActorClass

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
