"""The way of a pull-over at L3: how long it is, how far it goes sideways, and where it ends."""

from dataclasses import replace

import numpy as np
import pytest
from behaviour.civilians.pull_over_steps import NEAR, UNIT, emv_at

from siren_ros.behaviour.civilians.pull_over import edge_offset_m, pull_over, pull_over_path
from siren_ros.behaviour.driving.navigator import NavigatorState
from siren_ros.behaviour.paths.tracked_path import PEAK_CURVATURE
from siren_ros.world.actors import ActorClass, Mode

AMBULANCE = ActorClass.AMBULANCE


def test_stands_at_the_edge_and_over_it_where_the_lane_is_narrow(lab):
    wide = lab.straight_road()
    cars = [emv_at(lab), lab.Car(2, 0, 80, 5, (0,)), lab.Car(3, 1, 80, 5, (0,), ActorClass.TRUCK)]
    view = lab.view(wide, lab.L3, cars)
    truck = lab.vehicles[ActorClass.TRUCK].width_m
    assert edge_offset_m(view.ego(1), 0, -1) == pytest.approx(-(1.65 - 0.915))
    assert edge_offset_m(view.ego(2), 1, 1) == pytest.approx(min(1.4 - 1.65 + truck / 2, 1.65 - truck / 2 + 0.5))
    assert edge_offset_m(view.ego(1), 0, 1) == pytest.approx(1.65 - 0.915)
    narrow = lab.straight_road()
    trucks = [emv_at(lab), lab.Car(2, 0, 80, 5, (0,), ActorClass.TRUCK)]
    beside_others = lab.view(narrow, lab.L3, trucks)
    assert edge_offset_m(beside_others.ego(1), 0, 1) == pytest.approx(1.65 - truck / 2), "not into the lane on the left"
    assert edge_offset_m(beside_others.ego(1), 0, -1) < -(1.65 - truck / 2), "over the edge on the right"


def before_the_junction(lab, emv_s, car_s, car_mps):
    """An EMV that stands, and the civilian 2 ahead of it; the stop line is at 150 m."""
    world = lab.world_of(lab.junction_road(), lab.L3)
    cars = [lab.Car(1, 0, emv_s, 0, (0, 2), AMBULANCE), lab.Car(2, 0, car_s, car_mps, (0, 2))]
    loop = lab.Loop(world, cars, lambda _: {})
    loop.world = replace(world, speeds=replace(world.speeds, emv_route_follow_mps=0.0, emv_copy_sumo_mps=0.0))
    return loop


def test_stops_before_the_junction(lab):
    loop = before_the_junction(lab, 100, 130, 4).run(200)
    front = loop.body.x_m[1] + 4.75 / 2
    assert loop.modes[2] == Mode.YIELD_HOLD
    assert front < 150.0


def test_the_head_of_a_queue_holds_with_its_front_over_the_line_and_never_on_the_junction(lab):
    loop = before_the_junction(lab, 105, 146, 0).run(400)
    front = loop.body.x_m[1] + 4.75 / 2
    assert loop.modes[2] == Mode.YIELD_HOLD
    assert 151.0 < front <= 150.0 + loop.world.config.pull_over.head_over_line_m + 0.1


@pytest.mark.parametrize(("lane", "side"), [(0, -1), (1, 1)])
@pytest.mark.parametrize(("speed", "left"), [(0.0, 0.0), (2.0, 0.3), (8.0, -0.4)])
def test_the_path_to_the_edge_is_as_long_as_curvature_and_steering_ask(lab, world, lane, side, speed, left):
    """From where it is to the edge, by the largest of three lengths, and on until the vehicle has come straight."""
    car = lab.Car(2, lane, 80, speed, (0,), left=left)
    view = lab.view_in(world, [emv_at(lab), car])
    path = pull_over_path(replace(UNIT, side=side), view.ego(1), lane)
    config, target = world.config.pull_over, edge_offset_m(view.ego(1), lane, side)
    moving = min(max(speed, 1.5), world.speeds.civilian_pull_over_mps)
    way = abs(target - left)
    sharpest = (10.0 / np.sqrt(3.0) * way / config.curvature_max_1pm) ** 0.5
    steerable = max((40.0 * way * moving / view.ego(1).navigator_config.curvature_rate_1pms) ** (1.0 / 3.0), 3.0)
    wanted = max(config.length_min_m, sharpest, steerable)
    assert path.settled_m == pytest.approx(wanted, rel=1e-6)
    assert path.curve.points[0] == pytest.approx((80.0, 3.3 * lane + left))
    assert path.curve.points[-1, 1] == pytest.approx(3.3 * lane + target)
    length = lab.vehicles[ActorClass.SEDAN].length_m
    assert path.curve.points[-1, 0] == pytest.approx(80.0 + wanted + max(config.settle_length_m, length), abs=0.1)
    assert path.speed_cap_mps(path.length_m) < 0.1


def path_behind(lab, gap, network=None, s=80.0):
    """The path of a sedan at rest behind a standing one, and the vehicle's way to it."""
    network = network or lab.straight_road()
    length = lab.vehicles[ActorClass.SEDAN].length_m
    cars = [lab.Car(2, 0, s, 0, (0,)), lab.Car(3, 0, s + length + gap, 0, (0,))]
    view = lab.view(network, lab.L3, cars)
    return pull_over_path(replace(UNIT, side=-1), view.ego(0), 0), view.world.config.pull_over


def test_behind_a_standing_vehicle_it_goes_as_far_sideways_as_leaves_it_straight(lab):
    path, config = path_behind(lab, 4.5)
    way = 4.5 - config.room_standstill_gap_m
    end = path.curve.place(path.length_m)
    shift = config.curvature_max_1pm * way**2 / PEAK_CURVATURE
    assert end[0] - 80.0 == pytest.approx(way, abs=0.1)
    assert end[1] == pytest.approx(-shift, abs=0.03)
    assert abs(end[2]) < 0.05
    assert 0.2 < shift < 0.5
    far = path_behind(lab, 30.0)[0]
    assert far.curve.points[-1, 1] == pytest.approx(-(1.65 - 0.915), abs=0.01)


def test_there_is_no_way_to_the_edge_close_behind_a_standing_vehicle(lab):
    assert path_behind(lab, 2.5)[0] is None


def test_beside_a_shoulder_a_wide_vehicle_reaches_a_metre_over_the_edge_at_most(lab):
    """An EMV of 2.8 m and a fire engine need more than the lane has left; on the road's own edge 0.5 m is the most."""
    engine = ActorClass.FIRE_TRUCK
    half = 0.5 * lab.vehicles[engine].width_m
    for shoulder, lane, most in ((True, 1, 1.0), (False, 0, 0.5)):
        network = lab.straight_road(2 + shoulder, shoulder=shoulder)
        narrow = tuple(replace(item, width_m=2.6) for item in network.lanes)
        network = replace(network, lanes=narrow)
        view = lab.view(network, lab.L3, [emv_at(lab), replace(lab.Car(2, lane, 80, 5, (0,)), kind=engine)])
        at_edge = 1.3 - half
        wanted = 1.4 - 1.3 + half
        assert wanted > at_edge + most
        assert edge_offset_m(view.ego(1), lane, -1) == pytest.approx(-(at_edge + most))


@pytest.mark.parametrize(("before_m", "goes"), [(0.3, False), (0.6, True)])
def test_to_make_room_the_front_goes_4_m_over_the_line_if_that_is_2_m_of_way(lab, before_m, goes):
    """The centre is ``before_m`` from the line: the way is that, the 4 m and not the half length."""
    network = lab.junction_road()
    view = lab.view(network, lab.L3, [lab.Car(2, 1, 150.0 - before_m, 0, (0, 2))])
    assert before_m + 4.0 - 0.5 * lab.vehicles[ActorClass.SEDAN].length_m == pytest.approx(2.0, abs=0.3)
    path = pull_over_path(replace(UNIT, side=1, emv_waits_steps=30), view.ego(0), 1)
    assert (path is not None) is goes


def driven(lab, world, s, speed, path, progress, *, left, degrees=0.0):
    """One step of a driver on a path of its own, at a place and at an angle to the lane."""
    unit = replace(UNIT, phase=Mode.YIELD_PULL_OVER)
    navigator = replace(NavigatorState().following(path, 80.0, 0.0), progress_m=progress)
    poses = np.array([[20.0, 0.0, 0.0, 8.0], [s, left, np.radians(degrees), speed]])
    cars = [emv_at(lab, 20.0), lab.Car(2, 0, s, speed, (0,))]
    view = lab.view_in(world, cars, poses=poses)
    return pull_over(replace(unit, navigator=navigator), view.ego(1), NEAR)


@pytest.mark.parametrize(("left_m", "extended"), [(0.9, True), (1.1, False)])
def test_at_the_edge_and_not_straight_yet_the_path_goes_on_a_metre_before_its_end(lab, world, left_m, extended):
    view = lab.view_in(world, [emv_at(lab), lab.Car(2, 0, 80, 3, (0,))])
    path = pull_over_path(UNIT, view.ego(1), 0)
    progress = path.length_m - left_m
    s = float(path.curve.points[-1, 0]) - left_m
    outcome = driven(lab, world, s, 2.0, path, progress, left=-0.735, degrees=-5.0)
    assert outcome.unit.phase is Mode.YIELD_PULL_OVER
    assert (outcome.unit.navigator.path is not path) is extended


@pytest.mark.parametrize("speed", [2.0, 3.0])
def test_on_a_way_with_a_straight_piece_at_its_end_the_driver_goes_at_the_papers_speed(lab, world, speed):
    """On one that is only as long as the lateral move the driver creeps."""
    view = lab.view_in(world, [emv_at(lab), lab.Car(2, 0, 80, speed, (0,))])
    path = pull_over_path(UNIT, view.ego(1), 0)
    assert path.length_m - path.settled_m > 1.0
    start = path.curve.points[0]
    command = driven(lab, world, float(start[0]), speed, path, 0.0, left=0.0).command
    assert command.throttle > 0.0
    short = replace(path, settled_m=path.length_m - 0.4)
    command = driven(lab, world, float(start[0]), speed, short, 0.0, left=0.0).command
    assert command.throttle == 0.0
    assert command.brake > 0.0
