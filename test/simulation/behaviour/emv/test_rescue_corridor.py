from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from behaviour.lab import kinds

from siren_ros.base.numerics.geometry import wrap_angle
from siren_ros.base.numerics.units import NEVER
from siren_ros.simulation.behaviour.driving.driver_states import EmvUnit
from siren_ros.simulation.behaviour.driving.lane_change import forced_lane_change
from siren_ros.simulation.behaviour.driving.lane_path import path_on_lanes
from siren_ros.simulation.behaviour.driving.tracked_path import LaneEnd
from siren_ros.simulation.behaviour.emv import rescue_corridor as corridor
from siren_ros.simulation.behaviour.emv.controller import follow_route
from siren_ros.simulation.behaviour.emv.rescue_corridor import (
    along_corridor,
    braking_ahead,
    corridor_lane,
    corridor_mode,
    corridor_offsets,
    corridor_path,
    smoothed,
    way_opens,
)
from siren_ros.simulation.roads.road_network import LaneKind
from siren_ros.simulation.world.actors import ActorClass, Lights, Owner


def view_at(lab, others=(), network=None, lane=0, step=0, **traffic):
    network = network or lab.straight_road()
    cars = [lab.Car(1, lane, 100, 8, (0,), ActorClass.AMBULANCE), *others]
    return lab.view(network, lab.L3, cars, step=step, **traffic)


def on_route(view):
    return follow_route(EmvUnit(1), view.ego(0))[0]


YIELDING = {2: int(Owner.ROS)}


@pytest.mark.parametrize(
    ("place", "speed", "lights", "owners", "brakes"),
    [
        *[(150, 7, {2: int(Lights.BRAKE)}, YIELDING, True), (150, 0, {}, YIELDING, True)],
        *[(150, 7, {}, YIELDING, False), (150, 0, {2: int(Lights.BRAKE)}, {}, False)],
        *[(80, 0, {}, YIELDING, False), (185, 0, {}, YIELDING, False)],
    ],
    ids=["brakes", "holds", "drives on", "queues at a red light", "behind", "beyond the corridor"],
)
def test_yielding_vehicles_that_brake_ahead_open_a_corridor(lab, place, speed, lights, owners, brakes):
    network, *_ = lab.turned_road(2.2)
    view = view_at(lab, [lab.Car(2, 1, place, speed, (0,))], network, lights=lights, owners=owners)
    assert braking_ahead(on_route(view), view.ego(0)) is brakes


def test_neither_the_av_under_test_nor_another_emv_opens_a_corridor(lab):
    view = view_at(lab, [lab.Car(2, 1, 150, 0, (0,))], owners=YIELDING)
    assert braking_ahead(on_route(view), view.ego(0))
    watched = replace(view, world=replace(view.world, av_id=2))
    assert not braking_ahead(on_route(watched), watched.ego(0))
    other = view_at(lab, [lab.Car(2, 1, 150, 0, (0,), ActorClass.AMBULANCE)], owners=YIELDING)
    assert not braking_ahead(on_route(other), other.ego(0))


def test_cancels_and_suppresses_forced_lane_changes(lab):
    view = view_at(lab, advice={"rescue_count": 1, "lane_change_intent": 1})
    unit, events = corridor_mode(EmvUnit(1, change_side=1), view.ego(0))
    assert kinds(events) == ["lane_change_cancelled", "corridor_entered"]
    unit, events = forced_lane_change(unit, view.ego(0))
    assert not unit.lane_change_forced
    assert not events


def test_ends_when_nobody_reacts_any_more(lab):
    unit, _ = corridor_mode(EmvUnit(1), view_at(lab, advice={"rescue_count": 1}).ego(0))
    unit, events = corridor_mode(unit, view_at(lab, step=19).ego(0))
    assert unit.corridor
    unit, events = corridor_mode(unit, view_at(lab, step=20).ego(0))
    assert not unit.corridor
    assert kinds(events) == ["corridor_left"]


def offsets(view, lane):
    reference = path_on_lanes(view.world.network, (lane,), LaneEnd.HORIZON, 98.0, 80.0)
    return corridor_offsets(reference, np.linspace(2.0, 78.0, 77), view.ego(0))


@pytest.mark.parametrize(
    ("lanes", "lane", "expected"), [(1, 0, 0.0), (2, 0, 1.65), (2, 1, -1.65), (3, 0, 4.95), (3, 1, 1.65), (3, 2, -1.65)]
)
def test_runs_between_the_leftmost_lane_and_its_right_neighbour(lab, lanes, lane, expected):
    view = view_at(lab, network=lab.straight_road(lanes), lane=lane)
    np.testing.assert_allclose(offsets(view, lane), expected, atol=1e-9)


def test_moves_to_the_middle_of_what_the_vehicles_leave(lab):
    view = view_at(lab, [lab.Car(2, 0, 140, 0, (0,), left=-0.8), lab.Car(3, 1, 140, 0, (0,), left=0.2)])
    right, left = -0.8 + 0.915, 3.5 - 0.915
    assert offsets(view, 0)[40] == pytest.approx(0.5 * (right + left), abs=0.05)


@pytest.mark.parametrize(("right_m", "left_m"), [(-2.0, 2.0), (0.7, 2.0), (-2.0, -0.4), (0.3, -0.3)])
def test_in_ample_space_it_keeps_the_line_and_a_metre_to_those_who_stand_nearer(lab, right_m, left_m):
    """The line is 1.65 m left of the right lane's middle; cars have half a width of 0.915 m."""
    view = view_at(lab, [lab.Car(2, 0, 140, 0, (0,), left=right_m), lab.Car(3, 1, 140, 0, (0,), left=left_m)])
    half_m = view.ego(0).half_width_m
    least, most = right_m + 0.915 + half_m + 1.0, 3.3 + left_m - 0.915 - half_m - 1.0
    expected = 0.5 * (least + most) if least > most else min(max(1.65, least), most)
    assert offsets(view, 0)[40] == pytest.approx(expected, abs=0.05)


@pytest.mark.parametrize("kind", [ActorClass.BICYCLE, ActorClass.MOTORCYCLE, ActorClass.PEDESTRIAN])
@pytest.mark.parametrize("ahead_m", [34.0, 40.0, 46.0])
@pytest.mark.parametrize("on_cycle_lane", [True, False])
def test_people_at_the_side_do_not_draw_the_corridor_to_them(lab, kind, ahead_m, on_cycle_lane):
    """Riders on a cycle lane, people on foot: the vehicle on the left alone shapes it. Riders in the jam do."""
    road = lab.straight_road(3)
    first = replace(road.lanes[0], kind=LaneKind.CYCLE) if on_cycle_lane else road.lanes[0]
    network = replace(road, lanes=(first, *road.lanes[1:]))
    left, person = lab.Car(2, 2, 140, 0, (0,), left=0.2), lab.Car(3, 0, 100.0 + ahead_m, 0, (0,), kind, left=1.2)
    alone, together = (view_at(lab, cars, network=network, lane=1) for cars in ([left], [left, person]))
    if kind is ActorClass.PEDESTRIAN:
        together = replace(together, seen=replace(together.seen, people=np.array([[0.0]] * 6 + [[3.0]])))
    drawn = np.abs(offsets(together, 1) - offsets(alone, 1)).max() > 0.1
    assert drawn == (kind is not ActorClass.PEDESTRIAN and not on_cycle_lane)


@pytest.mark.parametrize(
    ("kind", "turned", "shapes"), [("AMBULANCE", 0.0, False), ("AMBULANCE", 3.1, True), ("VAN", 0.0, True)]
)
def test_another_emv_ahead_is_followed_and_does_not_shape_the_corridor(lab, kind, turned, shapes):
    """It stands in the middle of the two lanes. One that comes towards this one is passed as others are."""
    empty, other = view_at(lab), lab.Car(2, 0, 140, 0, (0,), ActorClass[kind])
    poses = [[100.0, 0.0, 0.0, 8.0], [140.0, 1.65, turned, 0.0]]
    offset = offsets(view_at(lab, [other], poses=np.array(poses)), 0)
    assert bool(np.abs(offset - offsets(empty, 0)).max() > 0.5) is shapes


@pytest.mark.parametrize(("aside_m", "drawn"), [(5.0, False), (2.0, True)])
def test_who_comes_towards_the_emv_does_not_draw_the_corridor_out_of_the_queues(lab, aside_m, drawn):
    """Between two drivers on the left nobody lines the corridor there, as far as there is room enough."""
    right = lab.Car(2, 0, 140, 0, (0,), ActorClass.BUS)
    poses = np.array([[100.0, 0.0, 0.0, 8.0], [140.0, -0.8, 0.0, 0.0], [140.0, aside_m, np.pi, 0.0]])
    alone = view_at(lab, [right], poses=poses[:2])
    together = view_at(lab, [right, lab.Car(3, 1, 140, 0, (0,))], poses=poses)
    assert bool(np.abs(offsets(together, 0) - offsets(alone, 0)).max() > 0.1) is drawn


@pytest.mark.parametrize(("turned_deg", "shapes"), [(90.0, False), (135.0, False), (170.0, True), (45.0, True)])
def test_a_vehicle_that_crosses_does_not_shape_the_corridor(lab, turned_deg, shapes):
    poses = np.array([[100.0, 0.0, 0.0, 8.0], [140.0, 2.0, np.radians(turned_deg), 0.0]])
    view = view_at(lab, [lab.Car(2, 0, 140, 0, (0,))], poses=poses)
    assert bool(np.abs(offsets(view, 0) - offsets(view_at(lab), 0)).max() > 0.5) is shapes


@pytest.mark.parametrize(
    ("speed", "owner", "opens"), [(1.0, Owner.ROS, True), (0.0, Owner.ROS, False), (1.0, Owner.SUMO, False)]
)
def test_the_way_opens_while_somebody_ahead_moves_aside(lab, speed, owner, opens):
    view = view_at(lab, [lab.Car(2, 1, 150, speed, (0,))], lab.turned_road(-2.2)[0], owners={2: int(owner)})
    unit = on_route(view)
    assert way_opens(replace(unit, corridor=True), view.ego(0)) is opens
    assert not way_opens(unit, view.ego(0)), "outside the corridor"


def test_the_corridor_is_on_the_shoulder_before_a_junction_beyond_which_it_turns(lab):
    network, route = lab.road_with_shoulder(), np.array([0, 2, 3], dtype=np.int32)
    assert corridor_lane(network, 1, route, 80.0) == 0
    assert corridor_lane(network, 3, route, 80.0) == 2, "on the junction as well"
    assert corridor_lane(network, 1, route, 40.0) == 1, "the turn is 50 m beyond the present edge"
    assert corridor_lane(network, 1, route[:2], 80.0) == 1
    assert corridor_lane(network, 3, route[1:], 80.0) == 3, "SUMO has the EMV on the next edge already"


@pytest.mark.parametrize("heading_deg", [0.0, 30.0, 135.0])
@pytest.mark.parametrize(("left_m", "turned_rad"), [(0.0, 0.0), (-0.8, 0.15), (2.5, -0.2)])
def test_the_path_begins_where_the_emv_is_as_it_points_and_ends_in_the_corridor(lab, heading_deg, left_m, turned_rad):
    """The EMV drives in the right lane; the line between both lanes is 1.65 m to the left of that lane's."""
    network, along, _ = lab.turned_road(np.radians(heading_deg))
    view = lab.view(network, lab.L3, [lab.Car(1, 0, 100, 8, (0,), ActorClass.AMBULANCE, left=left_m)])
    yaw = view.seen.yaw_rad + turned_rad
    view = replace(view, seen=replace(view.seen, yaw_rad=yaw, cos=np.cos(yaw), sin=np.sin(yaw)))
    curve = corridor_path(EmvUnit(1, corridor=True), view.ego(0)).navigator.path.curve
    s, left = curve.project_one(*view.ego(0).pose[:2])
    assert left == pytest.approx(0.0, abs=0.01)
    end = np.array([curve.length_m])
    assert network.lanes[0].centre.project(curve.at(end)[0])[1] == pytest.approx(1.65, abs=0.02)
    assert curve.at(end)[0] @ along == pytest.approx(180.0, abs=0.05), "80 m ahead"
    begins, goes_on = curve.heading_at(np.array([s, end[0]]))
    assert wrap_angle(begins - yaw[0]) == pytest.approx(0.0, abs=0.03)
    assert wrap_angle(goes_on - np.radians(heading_deg)) == pytest.approx(0.0, abs=0.01)


def test_straight_on_starts_from_the_offset_at_hand(lab):
    view = view_at(lab)
    reference = path_on_lanes(view.world.network, (1,), LaneEnd.HORIZON, 98.0, 80.0)
    s = np.linspace(2.0, 78.0, 77)
    np.testing.assert_allclose(corridor_offsets(reference, s, view.ego(0), straight_on_m=-1.2), -1.2)


def pocket_road(lab):
    """Two lanes; at 150 m a third one begins on the left, so that SUMO's rescue lane moves one lane to the left."""
    road = lab.RoadBuilder().edge([[0, 0], [150, 0]], 2, ("A", "B"))
    road.edge([[150, 0], [300, 0]], 3, ("B", "C"))
    return road.connect(0, 2).connect(1, 3).built()


@pytest.mark.parametrize("place_m", [100.0, 120.0, 140.0])
def test_the_line_moves_aside_as_gently_as_the_emv_does(lab, place_m):
    """A lane begins 10 to 50 m ahead. Alone and fast in the corridor, the EMV need not brake hard for it."""
    ego = lab.view(pocket_road(lab), lab.L3, [lab.Car(1, 1, place_m, 13.0, (0, 1), ActorClass.AMBULANCE)]).ego(0)
    path = corridor_path(EmvUnit(1, corridor=True), ego).navigator.path
    assert min(path.speed_cap_mps(s_m) for s_m in range(60)) > 9.0


@pytest.mark.parametrize(("where", "straight"), [(None, False), (0.75, True)], ids=["free", "closed"])
def test_goes_straight_on_where_a_vehicle_closes_the_way_to_a_lane_that_begins(lab, where, straight):
    cars = [lab.Car(1, 1, 135, 6, (0, 1), ActorClass.AMBULANCE, left=-1.65)]
    if where is not None:
        cars.append(lab.Car(2, 3, 12, 0, (1,), left=where))
    view = lab.view(pocket_road(lab), lab.L3, cars)
    path = corridor_path(EmvUnit(1, corridor=True), view.ego(0)).navigator.path
    _, left, _ = path.curve.project(np.array([162.0]), np.array([view.seen.y_m[0]]))
    assert (abs(float(left[0])) < 0.6) is straight


@pytest.mark.parametrize(
    ("straight_on", "where", "kept"),
    [(True, 0.75, True), (True, None, False), (False, 0.75, False)],
    ids=["the new one is closed", "the new one is free", "both are closed"],
)
def test_the_present_path_is_kept_where_it_stays_free_for_longer_than_a_new_one(lab, straight_on, where, kept):
    cars = [lab.Car(1, 1, 135, 6, (0, 1), ActorClass.AMBULANCE, left=-1.65)]
    network = pocket_road(lab)
    world = lab.world_of(network, lab.L3)
    before = lab.view_of(world, lab.traffic_of(network, cars))
    unit = replace(
        along_corridor(EmvUnit(1, corridor=True), before.ego(0), 1, straight_on=straight_on),
        corridor_planned_step=NEVER,
    )
    if where is not None:
        cars.append(lab.Car(2, 3, 12, 0, (1,), left=where))
    unit_after = corridor_path(unit, lab.view_of(world, lab.traffic_of(network, cars)).ego(0))
    assert (unit_after.navigator.path is unit.navigator.path) is kept
    assert unit_after.corridor_planned_step == before.step


def a_way(open_m, touches_m=np.inf):
    """A way on which the EMV has room for so far, and on which it touches somebody so far ahead."""
    return SimpleNamespace(limit=lambda *_: SimpleNamespace(free_m=open_m), free_m=touches_m)


@pytest.mark.parametrize("speed", [6.0, 3.0])
def test_the_present_path_is_kept_for_less_where_the_emv_cannot_stop_gently_on_the_new_one(lab, monkeypatch, speed):
    """With 2.5 m/s² it stops from 6 m/s in 7.2 m, from 3 m/s in 1.8 m; the present path gains a metre."""
    view = lab.view(lab.straight_road(), lab.L3, [lab.Car(1, 0, 100, speed, (0,), ActorClass.AMBULANCE)])
    unit = replace(
        along_corridor(EmvUnit(1, corridor=True), view.ego(0), 0, straight_on=False), corridor_planned_step=NEVER
    )
    monkeypatch.setattr(
        corridor,
        "free_way",
        lambda candidate, _: a_way(6.0 if candidate.navigator.path is unit.navigator.path else 5.0),
    )
    assert (corridor_path(unit, view.ego(0)).navigator.path is unit.navigator.path) is (speed == 6.0)


@pytest.mark.parametrize(("open_m", "kept"), [(0.5, True), (9.0, False)], ids=["too late to stop", "stops before"])
def test_where_the_emv_cannot_stop_the_path_that_gets_farther_without_a_touch_is_kept(lab, monkeypatch, open_m, kept):
    """Both paths are too tight from the same place on, and the present one touches nobody."""
    view = lab.view(lab.straight_road(), lab.L3, [lab.Car(1, 0, 100, 5.0, (0,), ActorClass.AMBULANCE)])
    unit = replace(
        along_corridor(EmvUnit(1, corridor=True), view.ego(0), 0, straight_on=False), corridor_planned_step=NEVER
    )

    def ahead(candidate, _):
        return a_way(open_m, np.inf if candidate.navigator.path is unit.navigator.path else 0.6)

    monkeypatch.setattr(corridor, "free_way", ahead)
    assert (corridor_path(unit, view.ego(0)).navigator.path is unit.navigator.path) is kept


@pytest.mark.parametrize("driven_m", [2.0, 10.0])
def test_a_new_path_ends_its_lateral_move_where_the_present_one_does(lab, straight, driven_m):
    """Each path begins where the EMV is; planned from its speed anew, the corridor would be reached later each time."""
    world = lab.world_of(straight, lab.L3)
    cars = [lab.Car(1, 0, 100, 8, (0,), ActorClass.AMBULANCE)]
    first = corridor_path(EmvUnit(1, corridor=True), lab.view_of(world, lab.traffic_of(straight, cars)).ego(0))
    start, path = first.navigator.progress_m, first.navigator.path
    x, y = path.curve.at(np.array([start + driven_m]))[0]
    yaw = float(path.curve.heading_at(np.array([start + driven_m]))[0])
    cars = [replace(cars[0], s=float(x), speed=14.0)]
    traffic = lab.traffic_of(straight, cars, step=8, poses=np.array([[x, y, yaw, 14.0]]))
    driving = replace(first, navigator=replace(first.navigator, progress_m=start + driven_m))
    again = corridor_path(driving, lab.view_of(world, traffic).ego(0))
    assert again.navigator.path is not path
    left_m = again.navigator.path.settled_m - again.navigator.progress_m
    assert left_m == pytest.approx(max(path.settled_m - start - driven_m, 8.0), abs=0.3)
    anew = corridor_path(EmvUnit(1, corridor=True), lab.view_of(world, traffic).ego(0))
    assert anew.navigator.path.settled_m > left_m + 2.0


@pytest.mark.parametrize("turned_rad", [0.9, -0.9])
def test_an_emv_that_points_far_off_begins_at_half_a_radian(lab, straight, turned_rad):
    car = lab.Car(1, 0, 100, 2, (0,), ActorClass.AMBULANCE, left=1.65)
    view = lab.view(straight, lab.L3, [car], poses=np.array([[100.0, 1.65, turned_rad, 2.0]]))
    curve = corridor_path(EmvUnit(1, corridor=True), view.ego(0)).navigator.path.curve
    assert curve.heading_at(np.array([0.0]))[0] == pytest.approx(np.sign(turned_rad) * 0.5, abs=0.05)


@pytest.mark.parametrize("step", [7, 8])
def test_the_corridor_is_planned_again_after_0_4_s(lab, step):
    planned = corridor_path(EmvUnit(1, corridor=True), view_at(lab).ego(0))
    again = corridor_path(planned, view_at(lab, step=step).ego(0))
    assert (again is planned) is (step == 7)
    assert again.corridor_planned_step == (0 if step == 7 else 8)
    assert again.plan is None


def test_a_vehicle_beside_the_road_or_beyond_the_corridor_leaves_it_as_it_is(lab):
    """8 m from the line is off the road, on either side; 80 m ahead the corridor ends."""
    on_the_right = lab.Car(2, 0, 140, 0, (0,), left=-0.8)
    alone = offsets(view_at(lab, [on_the_right]), 0)
    for other in (
        lab.Car(3, 1, 140, 0, (0,), left=5.0),
        lab.Car(3, 0, 140, 0, (0,), left=-8.3),
        lab.Car(3, 1, 177.5, 0, (0,), left=-0.5),
        lab.Car(3, 1, 99.0, 0, (0,), left=-0.5),
    ):
        np.testing.assert_allclose(offsets(view_at(lab, [on_the_right, other]), 0), alone)


@pytest.mark.parametrize(("opposite", "most"), [(False, 1.65), (True, 0.915 + 1.05 + 0.2)])
def test_on_one_lane_the_corridor_goes_to_the_free_side_as_far_as_the_road(lab, opposite, most):
    """Past a car in the middle of the lane; the opposite lane may be used where there is one."""
    network = lab.two_way_road() if opposite else lab.straight_road(1)
    view = view_at(lab, [lab.Car(2, 0, 140, 0, (0,), left=-0.01)], network=network)
    assert offsets(view, 0)[40] == pytest.approx(min(most, 0.915 + 1.05 + 0.2 - 0.01), abs=0.01)


@pytest.mark.parametrize("left", [-0.3, -0.01, 0.0, 0.01, 0.3])
def test_who_stands_in_the_middle_is_passed_on_the_side_with_more_room(lab, left):
    """On a road of one lane with another one for the opposite direction that is the left one, wherever rounding puts
    the vehicle."""
    view = view_at(lab, [lab.Car(2, 0, 140, 0, (0,), left=left)], network=lab.two_way_road())
    assert offsets(view, 0)[40] == pytest.approx(0.915 + 1.05 + 0.2 + left, abs=0.01)


def test_the_body_stays_on_the_road_beside_a_wide_vehicle_on_the_left(lab):
    bus = lab.Car(2, 1, 140, 0, (0,), ActorClass.BUS, left=-1.6)
    assert offsets(view_at(lab, [bus]), 0).min() == pytest.approx(-1.65 + 1.05, abs=1e-6)


def test_the_line_between_two_lanes_goes_on_across_a_junction(lab, junction):
    view = lab.view(junction, lab.L3, [lab.Car(1, 0, 120, 8, (0, 2), ActorClass.AMBULANCE)])
    reference = path_on_lanes(junction, (0, 2, 4), LaneEnd.HORIZON, 118.0, 80.0)
    middle_m = corridor_offsets(reference, np.linspace(2.0, 78.0, 77), view.ego(0))
    np.testing.assert_allclose(middle_m, 1.65, atol=1e-6)
    inside = path_on_lanes(junction, (2,), LaneEnd.HORIZON, 2.0, 20.0)
    np.testing.assert_allclose(corridor_offsets(inside, np.linspace(2.0, 18.0, 17), view.ego(0)), 0.0)


def test_inside_a_junction_the_line_still_comes_from_the_lanes_before_it(lab):
    """Behind the junction, which is 60 m long, a third lane on the left moves the line aside by a lane."""
    road = lab.RoadBuilder().edge([[0, 0], [100, 0]], 2, ("W", "J"))
    road.edge([[100, 0], [160, 0]], 2, ("J", "J"), internal=True)
    road.edge([[160, 0], [400, 0]], 3, ("J", "E"))
    network = road.connect(0, 4, via=(2,)).connect(1, 5, via=(3,)).built()
    for place_m, lane in ((20.0, 2), (40.0, 2)):
        view = lab.view(network, lab.L3, [lab.Car(1, lane, place_m, 2, (0, 2), ActorClass.AMBULANCE)])
        reference = path_on_lanes(network, (2, 4), LaneEnd.HORIZON, place_m - 2.0, 82.0)
        middle_m = corridor_offsets(reference, np.linspace(2.0, 82.0, 81), view.ego(0))
        assert middle_m[10] == pytest.approx(1.65 + 3.3 * (place_m + 10.0) / 60.0, abs=0.4)
        assert middle_m[70] == pytest.approx(4.95)


@pytest.mark.parametrize("radius", [1, 3])
def test_smoothing_is_a_weighted_mean_of_so_many_neighbours_and_leaves_short_lines(radius):
    values = np.zeros(30)
    values[15] = 1.0
    weights = 0.5 - 0.5 * np.cos(2.0 * np.pi * np.arange(1, 2 * radius + 2) / (2 * radius + 2))
    smooth = smoothed(values, radius)
    assert smooth[15 - radius : 16 + radius] == pytest.approx(weights / weights.sum())
    assert np.count_nonzero(np.abs(smooth) > 1e-12) == 2 * radius + 1
    assert smoothed(np.full(9, 2.5), radius) == pytest.approx(np.full(9, 2.5))
    step = np.concatenate((np.zeros(radius), np.ones(radius)))
    assert smoothed(step, radius) is step
    assert smoothed(np.append(step, 1.0), radius) is not step
    assert len(smoothed(np.append(step, 1.0), radius)) == 2 * radius + 1
    assert 0.0 < smoothed(np.append(step, 1.0), radius)[radius] < 1.0
    assert smoothed(values, 0) is values


@pytest.mark.parametrize(("left_m", "turned_rad"), [(1.2, 0.0), (1.9, 0.1), (0.6, -0.1)])
def test_the_path_begins_as_the_emv_points_also_where_the_corridor_bends_at_once(lab, straight, left_m, turned_rad):
    """Vehicles stand next to the EMV and just ahead, so that the corridor moves aside from its first metre on."""
    cars = [
        lab.Car(1, 0, 100, 6, (0,), ActorClass.AMBULANCE),
        lab.Car(2, 0, 109, 0, (0,), left=-0.3),
        lab.Car(3, 1, 118, 0, (0,), left=1.0),
    ]
    poses = np.array([[100.0, left_m, turned_rad, 6.0], [109.0, -0.3, 0.0, 0.0], [118.0, 4.3, 0.0, 0.0]])
    view = lab.view(straight, lab.L3, cars, poses=poses)
    reference = path_on_lanes(straight, (0,), LaneEnd.HORIZON, 98.0, 82.0)
    target = corridor_offsets(reference, np.linspace(2.0, 82.0, 81), view.ego(0))
    assert abs(target[1] - target[0]) > 0.01
    curve = corridor_path(EmvUnit(1, corridor=True), view.ego(0)).navigator.path.curve
    assert curve.heading_at(np.array([0.0]))[0] == pytest.approx(turned_rad, abs=0.012)


@pytest.mark.parametrize("driven_m", [1.0, 2.0, 4.0])
def test_a_new_path_goes_on_in_the_bend_of_the_present_one_where_the_corridor_bends(lab, straight, driven_m):
    """A path that forgets the bend in which the EMV is lets it swing over, towards the vehicles next to it."""

    def view_of(x_m, left_m, turned_rad, step):
        poses = np.array([[x_m, left_m, turned_rad, 6.0], [109.0, -0.3, 0.0, 0.0], [118.0, 4.3, 0.0, 0.0]])
        cars = [
            lab.Car(1, 0, x_m, 6, (0,), ActorClass.AMBULANCE),
            lab.Car(2, 0, 109, 0, (0,), left=-0.3),
            lab.Car(3, 1, 118, 0, (0,), left=1.0),
        ]
        return lab.view(straight, lab.L3, cars, poses=poses, step=step)

    present = corridor_path(EmvUnit(1, corridor=True), view_of(100.0, 1.2, 0.0, 0).ego(0))
    x_m, y_m, heading_rad, bend_1pm = present.navigator.path.curve.place(driven_m)
    assert abs(bend_1pm) > 0.01
    ego = view_of(x_m, y_m, heading_rad, 8).ego(0)
    again = along_corridor(present, ego, 0, straight_on=False).navigator
    _, _, begins_rad, begins_1pm = again.path.curve.place(again.progress_m)
    assert begins_rad == pytest.approx(heading_rad, abs=0.004)
    assert begins_1pm == pytest.approx(bend_1pm, abs=0.006)


def test_a_corridor_that_begins_again_is_planned_at_once(lab):
    """Nothing of the last one is left."""
    was = EmvUnit(1, corridor=True, corridor_seen_step=10, corridor_planned_step=28)
    unit, _ = corridor_mode(was, view_at(lab, step=30).ego(0))
    assert not unit.corridor
    assert unit.corridor_planned_step == NEVER
    assert unit.plan is None


@pytest.mark.parametrize(
    ("limit_mps", "own_mps", "other_mps", "place_m", "entered"),
    [
        *[(36.1, 15.0, 2.0, 140.0, True), (36.1, 15.0, 8.4, 140.0, False), (36.1, 15.0, 2.0, 60.0, False)],
        *[(36.1, 17.1, 2.0, 140.0, False), (13.9, 17.1, 8.4, 140.0, True)],
    ],
    ids=["jam", "flowing traffic", "jam behind", "too fast", "in town"],
)
def test_out_of_town_only_slow_traffic_ahead_forms_a_corridor(lab, limit_mps, own_mps, other_mps, place_m, entered):
    network, *_ = lab.turned_road(2.2)
    network = replace(network, lanes=tuple(replace(lane, speed_limit_mps=limit_mps) for lane in network.lanes))
    cars = [lab.Car(1, 0, 100.0, own_mps, (0,), ActorClass.AMBULANCE), lab.Car(2, 1, place_m, other_mps, (0,))]
    unit, _ = corridor_mode(EmvUnit(1), lab.view(network, lab.L3, cars, advice={"rescue_count": 1}).ego(0))
    assert unit.corridor is entered


def test_the_corridor_is_followed_through_a_bend_at_the_bends_speed(lab):
    """A bend to the right with a radius of 12 m, whose middle is the corridor on a road of one lane."""
    angle = np.linspace(0.0, np.pi / 2.0, 40)
    bend = np.stack((60.0 + 12.0 * np.sin(angle), -12.0 + 12.0 * np.cos(angle)), axis=-1)
    network = lab.RoadBuilder().edge([[0.0, 0.0], *bend, [72.0, -150.0]], 1, ("A", "B")).built()
    cars = [lab.Car(1, 0, 20, 8, (0,), ActorClass.AMBULANCE)]
    loop = lab.Loop(lab.world_of(network, lab.L3), cars, lambda _: {"rescue_count": 1}).run(240)
    poses = np.array([row[1][:4] for row in loop.log])
    s_m, left_m = network.lanes[0].centre.project(poses[:, :2])
    assert s_m[-1] > 100.0
    assert np.abs(left_m).max() < 0.4
    slowest_mps = np.sqrt(loop.world.config.emv_driver.driving.lateral_accel_mps2 * 12.0)
    assert poses[:, 3].min() > 0.75 * slowest_mps


@pytest.mark.parametrize(("aside_m", "on_path"), [(0.0, True), (0.25, True), (0.35, False)])
def test_a_new_path_begins_on_the_present_one_while_the_emv_is_on_it(lab, aside_m, on_path):
    """The EMV points 0.05 rad to the left of its path."""
    view = view_at(lab)
    unit = along_corridor(on_route(view), view.ego(0), 0, straight_on=False)
    pose = np.array([[110.0, view.ego(0).place[1] + aside_m, 0.05, 8.0]])
    path = unit.navigator.path
    progress_m, off_m = path.curve.nearest_to(10.0, *pose[0, :2])
    pose[0, 1] += aside_m - off_m
    later = view_at(lab, step=10, poses=pose)
    again = along_corridor(unit, later.ego(0), 0, straight_on=False).navigator
    x, y, yaw, _ = again.path.curve.place(again.progress_m)
    assert np.hypot(x - pose[0, 0], y - pose[0, 1]) == pytest.approx(aside_m if on_path else 0.0, abs=0.02)
    assert yaw == pytest.approx(path.curve.place(progress_m)[2] if on_path else 0.05, abs=0.015)
