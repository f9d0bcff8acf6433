"""Civilians at L3: when, where and to which side a pull-over starts, how long its way is, and who is in the way."""

from dataclasses import replace

import numpy as np
import pytest
from behaviour import lab
from behaviour.civilians.civilian_steps import NEAR, UNIT, emv_at, shoulder_road, steps
from behaviour.lab import kinds

from siren_ros.simulation.behaviour.civilians.pull_over import (
    CURVATURE_MAX_1PM,
    SETTLE_LENGTH_M,
    alignment_of,
    edge_offset_m,
    emv_waits_behind,
    makes_room,
    may_go_on,
    pull_over,
    pull_over_path,
    rider_comes_up,
    start_pull_over,
)
from siren_ros.simulation.behaviour.civilians.yield_lane_change import LEAST_SIDEWAYS_M
from siren_ros.simulation.behaviour.driving.navigator import NavigatorState
from siren_ros.simulation.behaviour.driving.tracked_path import PEAK_CURVATURE
from siren_ros.simulation.roads.road_network import LaneKind
from siren_ros.simulation.world.actors import ActorClass, Mode, SignalState

AMBULANCE = ActorClass.AMBULANCE
WAITED = replace(UNIT, emv_waits_steps=30)


def view_of(lab, *cars, network=None):
    network = network or lab.straight_road()
    return lab.view(network, lab.L3, list(cars))


@pytest.mark.parametrize(
    ("s", "lane", "speed", "waits"),
    [
        *[(112.0, 0, 0.0, True), (112.0, 1, 0.0, True), (112.0, 0, 1.5, True), (112.0, 0, 1.6, False)],
        *[(159.0, 0, 0.0, True), (161.0, 0, 0.0, False), (88.0, 0, 0.0, False), (101.0, 1, 0.0, False)],
    ],
)
def test_the_emv_waits_behind_where_it_stands_or_crawls_near_and_headed_for_the_vehicle(lab, s, lane, speed, waits):
    view = view_of(lab, lab.Car(1, 0, 100, speed, (0,), AMBULANCE), lab.Car(2, lane, s, 0, (0,)))
    assert emv_waits_behind(view.ego(1), 0) is waits
    assert not emv_waits_behind(view.ego(1), -1)


@pytest.mark.parametrize("turn", np.radians([0.0, -150.0]))
@pytest.mark.parametrize(
    ("bearing", "own_yaw", "other_yaw", "waits"),
    [
        *[(0.0, 0.0, 0.0, True), (50.0, 0.0, 0.0, True), (-50.0, 0.0, 0.0, True)],
        *[(70.0, 0.0, 0.0, False), (-70.0, 0.0, 0.0, False), (0.0, 70.0, 0.0, False)],
        *[(0.0, 0.0, 70.0, False), (0.0, 0.0, -70.0, False), (180.0, 0.0, 0.0, False)],
    ],
)
def test_behind_is_within_60_degrees_of_both_directions(lab, straight, turn, bearing, own_yaw, other_yaw, waits):
    """The vehicle is 12 m from the EMV in a direction; both look in their own; everything is turned."""
    at = turn + np.radians(bearing)
    poses = np.array(
        [
            [100.0, 0.0, turn + np.radians(own_yaw), 0.0],
            [100.0 + 12.0 * np.cos(at), 12.0 * np.sin(at), turn + np.radians(other_yaw), 0.0],
        ]
    )
    cars = [lab.Car(1, 0, 100, 0, (0,), AMBULANCE), lab.Car(2, 0, 112, 0, (0,))]
    assert emv_waits_behind(lab.view(straight, lab.L3, cars, poses=poses).ego(1), 0) is waits


def test_room_is_made_after_the_emv_has_waited_for_a_while(lab):
    view = view_of(lab, lab.Car(1, 0, 100, 0, (0,), AMBULANCE), lab.Car(2, 0, 112, 0, (0,)))
    assert not makes_room(replace(UNIT, emv_waits_steps=29), view)
    assert makes_room(WAITED, view)


@pytest.mark.parametrize(
    ("unit", "gap", "goes"),
    [
        *[(UNIT, 50.0, False), (replace(UNIT, partial=True), 4.5, True), (replace(UNIT, partial=True), 3.5, False)],
        *[(WAITED, 3.5, True), (WAITED, 2.0, False)],
    ],
)
def test_goes_on_where_the_way_ahead_is_free(lab, unit, gap, goes):
    length = lab.vehicles[ActorClass.SEDAN].length_m
    view = view_of(lab, lab.Car(2, 0, 112, 0, (0,)), lab.Car(3, 0, 112 + length + gap, 0, (0,)))
    assert may_go_on(unit, view.ego(0), 0) is goes


def test_the_front_goes_over_the_stop_line_only_to_make_room_or_at_the_head_of_a_standing_queue(lab, junction):
    half = 0.5 * lab.vehicles[ActorClass.SEDAN].length_m
    red = (SignalState("J", "r"),)
    traffic = replace(lab.traffic_of(junction, [lab.Car(2, 1, 149.0 - half, 0, (0, 2))]), signals=red)
    view = lab.view_of(lab.world_of(junction, lab.L3), traffic)
    left, config = replace(UNIT, side=1), view.world.config.civilian_driver.pull_over
    for unit, over in ((left, config.head_over_line_m), (replace(left, emv_waits_steps=30), config.room_over_line_m)):
        front = pull_over_path(unit, view.ego(0), 1).curve.points[-1, 0] + half
        assert 150.0 + 0.5 * over < front < 150.0 + over + 0.5
    rolling, coming = (view_of(lab, lab.Car(2, 1, s, 2.0, (0, 2)), network=junction) for s in (149.0 - half, 139.0))
    assert pull_over_path(left, rolling.ego(0), 1) is None
    assert 148.0 < pull_over_path(left, coming.ego(0), 1).curve.points[-1, 0] + half < 150.0


@pytest.mark.parametrize("kind", [LaneKind.SHOULDER, LaneKind.KERB, LaneKind.SIDEWALK])
def test_a_vehicle_goes_over_the_stop_line_beside_a_strip_that_nobody_uses_and_not_beside_a_shoulder(lab, kind):
    road = lab.RoadBuilder().edge([[0.0, 0.0], [150.0, 0.0]], 2, ("W", "J"), shoulder=True)
    road.edge([[150.0, 3.3], [175.0, 3.3]], 1, ("J", "J"), internal=True)
    road.edge([[175.0, 0.0], [400.0, 0.0]], 2, ("J", "E"), shoulder=True)
    road.connect(1, 4, via=(2,), signal=True)
    network = road.built()
    lanes = tuple(
        replace(lane, kind=kind, emergency_allowed=kind is LaneKind.SHOULDER)
        if lane.kind is LaneKind.SHOULDER
        else lane
        for lane in network.lanes
    )
    half = 0.5 * lab.vehicles[ActorClass.SEDAN].length_m
    view = view_of(lab, lab.Car(2, 1, 149.0 - half, 0, (0, 2)), network=replace(network, lanes=lanes))
    path = pull_over_path(WAITED, view.ego(0), 1)
    assert path is None if kind is LaneKind.SHOULDER else path.curve.points[-1, 0] + half > 151.0


@pytest.mark.parametrize("unit", [UNIT, WAITED], ids=["at once", "an EMV waits"])
@pytest.mark.parametrize("speed", [0.0, 5.0])
def test_on_a_junction_only_who_has_an_emv_waiting_behind_pulls_over(lab, unit, speed):
    view = view_of(lab, lab.Car(2, 2, 5.0, speed, (0, 2)), network=lab.junction_road())
    outcome = start_pull_over(unit, view.ego(0))
    assert outcome.unit.phase is (Mode.YIELD_PULL_OVER if unit is WAITED else Mode.YIELD_DEFERRED)
    assert (outcome.command is None) is (unit is UNIT)
    assert outcome.unit.deferred == ("junction" if unit is UNIT else "")


def in_queue(lab, world, speed=0.0, left=0.0, turned=0.0, apart_m=0.0):
    """The first steps of a driver in lane 1 and one in lane 2, as an EMV comes that will turn right."""
    cars = [
        lab.Car(1, 1, 40, 8, (0, 1), ActorClass.AMBULANCE),
        lab.Car(2, 1, 75, speed, (0, 2)),
        lab.Car(3, 2, 75 - apart_m, speed, (0, 2)),
    ]
    poses = np.array([[40.0, 3.3, 0.0, 8.0], [75.0, 3.3 + left, turned, speed], [75.0 - apart_m, 6.6, 0.0, speed]])
    return steps(world, cars, 30, poses=poses)


def test_who_stands_and_leaves_the_shoulder_free_stays_there(lab):
    state, commands, events = in_queue(lab, shoulder_road(lab))
    assert {actor: unit.phase for actor, unit in state.units.items()} == dict.fromkeys((2, 3), Mode.YIELD_HOLD)
    assert commands.brake.tolist() == [1.0, 1.0]
    recorded = {kind: sorted(e.actor_id for e in events if e.kind.value == kind) for kind in kinds(events)}
    assert recorded == {kind: [2, 3] for kind in ("yield_requested", "yield_started", "yield_held")}
    assert [event.detail["partial"] for event in events if event.kind.value == "yield_held"] == [0, 0]


@pytest.mark.parametrize(
    ("place", "phase"),
    [
        *[({"left": -1.4}, Mode.YIELD_HOLD), ({"left": -1.5}, Mode.YIELD_PULL_OVER)],
        *[({"turned": -0.2}, Mode.YIELD_PULL_OVER), ({"speed": 1.4}, Mode.YIELD_HOLD)],
        ({"speed": 1.6}, Mode.YIELD_PULL_OVER),
    ],
)
def test_who_stands_in_the_way_along_the_shoulder_or_drives_pulls_over(lab, place, phase):
    # 3.3 m of shoulder and 1.65 m to the lane's middle, less half a width of 0.915 m, are 4.035 m; 2.6 m are needed.
    state, _, _ = in_queue(lab, shoulder_road(lab), **place)
    assert state.units[2].phase is phase
    assert state.units[2].side == 1


@pytest.mark.parametrize(("width", "phase"), [(1.9, Mode.YIELD_HOLD), (1.83, Mode.YIELD_PULL_OVER)])
def test_next_to_a_narrow_shoulder_all_lanes_go_to_the_left(lab, width, phase):
    state, _, _ = in_queue(lab, shoulder_road(lab, width))
    assert {state.units[actor].phase for actor in (2, 3)} == {phase}


@pytest.mark.parametrize(("apart_m", "phase"), [(14.0, Mode.YIELD_PULL_OVER), (16.0, Mode.YIELD_HOLD)])
def test_a_driver_gives_space_to_who_stands_near_on_the_right(lab, apart_m, phase):
    state, _, _ = in_queue(lab, shoulder_road(lab, 1.83), apart_m=apart_m)
    assert (state.units[2].phase, state.units[3].phase) == (Mode.YIELD_PULL_OVER, phase)


@pytest.mark.parametrize(
    ("lanes", "shoulder", "expected"),
    [(1, False, [-1]), (2, False, [-1, 1]), (3, False, [-1, -1, 1]), (3, True, [-1, -1, 1]), (2, True, [-1, -1])],
)
def test_leftmost_lane_goes_left_all_others_right(lab, lanes, shoulder, expected):
    view = lab.view(lab.straight_road(lanes, shoulder=shoulder), lab.L3, [emv_at(lab)])
    assert [alignment_of(view.network, lane) for lane in range(lanes)] == expected


def test_everybody_before_the_turn_goes_left_where_the_emv_comes_on_the_shoulder(lab):
    world = shoulder_road(lab)

    def sides(emv_route):
        cars = [
            *[lab.Car(1, 1, 40, 8, emv_route, AMBULANCE), lab.Car(2, 1, 75, 5, (0, 2))],
            *[lab.Car(3, 2, 75, 5, (0, 2)), lab.Car(4, 4, 20, 5, (1,))],
        ]
        state, _, _ = steps(world, cars, 30)
        return {actor: unit.side for actor, unit in state.units.items() if unit.phase is Mode.YIELD_PULL_OVER}

    assert (sides((0, 1)), sides((0, 2))) == ({2: 1, 3: 1}, {2: -1, 3: 1})


def joined_road(lab, *, oncoming_turns=False):
    """Two lanes, a path of 30 m over a junction, two lanes; the oncoming traffic of some turns left across it."""
    road = lab.RoadBuilder().edge([[0, 0], [100, 0]], 2, ("W", "J"))
    road.edge([[100, 0], [130, 0]], 2, ("J", "J"), internal=True)
    road.edge([[130, 0], [300, 0]], 2, ("J", "E"))
    road.connect(0, 4, via=(2,)).connect(1, 5, via=(3,))
    if oncoming_turns:
        road.edge([[300, 10], [130, 10]], 1, ("E", "J"))
        road.edge([[130, 10], [115, -20]], 1, ("J", "J"), internal=True)
        road.edge([[115, -20], [115, -100]], 1, ("J", "S"))
        road.connect(6, 8, via=(7,), direction="l")
    return road.built()


@pytest.mark.parametrize("emv_m", [90.0, 60.0])
def test_who_crosses_leaves_as_much_road_behind_the_junction_as_stands_before_the_emv(lab, emv_m):
    half_m = 0.5 * lab.vehicles[ActorClass.SEDAN].length_m
    cars = [lab.Car(1, 0, 149.0 - half_m - emv_m, 0.0, (0, 2), AMBULANCE), lab.Car(2, 1, 149.0 - half_m, 0, (0, 2))]
    view = view_of(lab, *cars, network=lab.junction_road())
    end_m = pull_over_path(WAITED, view.ego(1), 1).curve.points[-1, 0]
    assert end_m - half_m == pytest.approx(175.0 + 2.0 + emv_m, abs=4.0)


@pytest.mark.parametrize("crossed", [False, True])
def test_pulls_over_on_a_junction_that_nobody_crosses(lab, crossed):
    world = lab.world_of(joined_road(lab, oncoming_turns=crossed), lab.L3)
    cars = [lab.Car(1, 0, 90, 8, (0, 2), AMBULANCE), lab.Car(2, 2, 15, 3, (0, 2)), lab.Car(3, 3, 15, 3, (0, 2))]
    state, _, events = steps(world, cars, 40)
    expected = "yield_deferred" if crossed else "yield_started"
    assert [event.actor_id for event in events if event.kind.value == expected] == [2, 3]
    assert [state.units[actor].side for actor in (2, 3)] == ([0, 0] if crossed else [-1, 1])


@pytest.mark.parametrize(("ahead", "yields"), [(0.1, True), (-0.1, False)])
def test_a_vehicle_at_the_emvs_side_pulls_over_where_its_front_is_ahead_of_the_emvs(lab, world, ahead, yields):
    front = 50.0 + 0.5 * lab.vehicles[AMBULANCE].length_m
    centre = front + ahead - 0.5 * lab.vehicles[ActorClass.SEDAN].length_m
    _, commands, events = steps(world, [emv_at(lab), lab.Car(2, 1, centre, 5, (0,))])
    assert (kinds(events) == ["yield_requested", "yield_started"]) is yields
    assert (commands.actor_id.tolist() == [2]) is yields


def test_a_queue_that_stands_too_close_waits_for_the_one_ahead(lab):
    cars = [emv_at(lab), lab.Car(2, 0, 80, 0, (0,)), lab.Car(3, 0, 87.25, 0, (0,))]
    _, _, events = steps(lab.world_of(lab.straight_road(), lab.L3), cars, 10)
    mine = [event for event in events if event.actor_id == 2]
    assert (kinds(mine), mine[1].detail["reason"]) == (["yield_requested", "yield_deferred"], "no_room")


def test_a_pull_over_starts_where_the_way_of_a_stop_is_no_longer_than_the_path_and_a_little(lab, junction):
    """The path ends before the junction; from each place and speed the rule says whether it is long enough."""
    world = lab.world_of(junction, lab.L3)
    brake = world.config.civilian_driver.driving.comfort_brake_mps2
    unit = replace(UNIT, phase=Mode.YIELD_REACTING, side=-1)
    verdicts = set()
    for s in (100.0, 115.0, 125.0, 132.0, 138.0):
        for speed in (6.0, 8.0, 9.0, 10.0, 11.0, 12.5):
            cars = [lab.Car(1, 0, 60, 8, (0, 2), AMBULANCE), lab.Car(2, 0, s, speed, (0, 2))]
            view = lab.view_of(world, lab.traffic_of(junction, cars))
            path = pull_over_path(unit, view.ego(1), 0)
            long_enough = path is not None and speed**2 / (2.0 * brake) <= path.length_m + 6.0
            starts = start_pull_over(unit, view.ego(1)).unit.phase is Mode.YIELD_PULL_OVER
            assert starts is long_enough, (s, speed)
            verdicts.add((starts, path is not None and speed**2 / brake > path.length_m + 6.0))
    assert verdicts >= {(True, True), (True, False), (False, True)}


def test_what_a_deferral_left_is_gone_when_the_pull_over_starts(lab, world):
    view = lab.view_in(world, [emv_at(lab), lab.Car(2, 0, 80, 5, (0,))])
    waiting = replace(UNIT, phase=Mode.YIELD_DEFERRED, deferred="no_room", stopped_steps=40)
    started = start_pull_over(waiting, view.ego(1)).unit
    assert started.phase is Mode.YIELD_PULL_OVER
    assert (started.deferred, started.stopped_steps) == ("", 0)


@pytest.mark.parametrize(("step", "looks"), [(11, False), (12, True), (13, False), (22, True)])
@pytest.mark.parametrize("speed", [0.0, 1.0])
def test_a_deferred_driver_who_stands_looks_again_each_half_second(lab, world, step, looks, speed):
    """Actor 2 at the steps 2, 12, 22 and so on; who drives looks at every step."""
    view = lab.view_in(world, [emv_at(lab), lab.Car(2, 0, 80, speed, (0,))], step=step)
    outcome = start_pull_over(replace(UNIT, phase=Mode.YIELD_DEFERRED, deferred="no_room"), view.ego(1))
    assert (outcome.unit.phase is Mode.YIELD_PULL_OVER) is (looks or speed > 0.0)


def test_stands_at_the_edge_and_over_it_where_the_lane_is_narrow(lab):
    cars = [emv_at(lab), lab.Car(2, 0, 80, 5, (0,)), lab.Car(3, 1, 80, 5, (0,), ActorClass.TRUCK)]
    view = lab.view(lab.straight_road(), lab.L3, cars)
    truck = lab.vehicles[ActorClass.TRUCK].width_m
    assert edge_offset_m(view.ego(1), 0, -1) == pytest.approx(-(1.65 - 0.915))
    assert edge_offset_m(view.ego(2), 1, 1) == pytest.approx(min(1.4 - 1.65 + truck / 2, 1.65 - truck / 2 + 0.5))
    assert edge_offset_m(view.ego(1), 0, 1) == pytest.approx(1.65 - 0.915)
    beside_others = lab.view(lab.straight_road(), lab.L3, [emv_at(lab), lab.Car(2, 0, 80, 5, (0,), ActorClass.TRUCK)])
    assert edge_offset_m(beside_others.ego(1), 0, 1) == pytest.approx(1.65 - truck / 2), "not into the lane on the left"
    assert edge_offset_m(beside_others.ego(1), 0, -1) < -(1.65 - truck / 2), "over the edge on the right"
    cars[1] = lab.Car(2, 1, 80, 5, (0,), ActorClass.TRUCK)
    between = lab.view(lab.straight_road(3), lab.L3, cars[:2])
    assert edge_offset_m(between.ego(1), 1, -1) == edge_offset_m(beside_others.ego(1), 0, -1), "and into a lane there"


@pytest.mark.parametrize(("lane", "side"), [(0, -1), (1, 1)])
@pytest.mark.parametrize(("speed", "left"), [(0.0, 0.0), (2.0, 0.3), (8.0, -0.4)])
def test_the_path_to_the_edge_is_as_long_as_curvature_and_steering_ask(lab, world, lane, side, speed, left):
    """From where it is to the edge, by the largest of three lengths, and on until the vehicle has come straight."""
    view = lab.view_in(world, [emv_at(lab), lab.Car(2, lane, 80, speed, (0,), left=left)])
    path = pull_over_path(replace(UNIT, side=side), view.ego(1), lane)
    target = edge_offset_m(view.ego(1), lane, side)
    moving = min(max(speed, 1.5), world.speeds.civilian_pull_over_mps)
    way = abs(target - left)
    sharpest = (10.0 / np.sqrt(3.0) * way / CURVATURE_MAX_1PM) ** 0.5
    steerable = max((40.0 * way * moving / view.ego(1).navigator_config.curvature_rate_1pms) ** (1.0 / 3.0), 3.0)
    expected = max(LEAST_SIDEWAYS_M, sharpest, steerable)
    assert path.settled_m == pytest.approx(expected, rel=1e-6)
    assert path.curve.points[0] == pytest.approx((80.0, 3.3 * lane + left))
    assert path.curve.points[-1, 1] == pytest.approx(3.3 * lane + target)
    length = lab.vehicles[ActorClass.SEDAN].length_m
    assert path.curve.points[-1, 0] == pytest.approx(80.0 + expected + max(SETTLE_LENGTH_M, length), abs=0.1)
    assert path.speed_cap_mps(path.length_m) < 0.1


def path_behind(lab, gap, network=None, s=80.0):
    """The path of a sedan at rest behind a standing one, and the vehicle's way to it."""
    network = network or lab.straight_road()
    length = lab.vehicles[ActorClass.SEDAN].length_m
    view = lab.view(network, lab.L3, [lab.Car(2, 0, s, 0, (0,)), lab.Car(3, 0, s + length + gap, 0, (0,))])
    return pull_over_path(replace(UNIT, side=-1), view.ego(0), 0), view.world.config.civilian_driver.pull_over


def test_behind_a_standing_vehicle_it_goes_as_far_sideways_as_leaves_it_straight(lab):
    path, config = path_behind(lab, 4.5)
    way = 4.5 - config.room_standstill_gap_m
    end = path.curve.place(path.length_m)
    shift = CURVATURE_MAX_1PM * way**2 / PEAK_CURVATURE
    assert (end[0] - 80.0, end[1]) == (pytest.approx(way, abs=0.1), pytest.approx(-shift, abs=0.03))
    assert abs(end[2]) < 0.05
    assert 0.2 < shift < 0.5
    assert path_behind(lab, 30.0)[0].curve.points[-1, 1] == pytest.approx(-(1.65 - 0.915), abs=0.01)


def test_beside_a_shoulder_a_wide_vehicle_reaches_a_metre_over_the_edge_at_most(lab):
    """An EMV of 2.8 m and a fire engine need more than the lane has left; on the road's own edge 0.5 m is the most."""
    engine = ActorClass.FIRE_TRUCK
    half = 0.5 * lab.vehicles[engine].width_m
    for shoulder, lane, most in ((True, 1, 1.0), (False, 0, 0.5)):
        network = lab.straight_road(2 + shoulder, shoulder=shoulder)
        network = replace(network, lanes=tuple(replace(item, width_m=2.6) for item in network.lanes))
        view = lab.view(network, lab.L3, [emv_at(lab), replace(lab.Car(2, lane, 80, 5, (0,)), kind=engine)])
        at_edge = 1.3 - half
        assert (1.4 - 1.3 + half) > at_edge + most
        assert edge_offset_m(view.ego(1), lane, -1) == pytest.approx(-(at_edge + most))


@pytest.mark.parametrize(("before_m", "goes"), [(-7.9, False), (-7.3, True)])
def test_to_make_room_the_front_goes_12_m_over_the_line_if_that_is_2_m_of_way(lab, before_m, goes):
    """The centre is ``before_m`` from the line: the way is that, the 12 m and not the half length."""
    network = lab.junction_road()
    car = lab.Car(2, 1, 140.0, 0, (0, 2))
    poses = np.array([[150.0 - before_m, 3.3, 0.0, 0.0]])
    traffic = replace(lab.traffic_of(network, [car], poses=poses), signals=(SignalState("J", "r"),))
    assert before_m + 12.0 - 0.5 * lab.vehicles[ActorClass.SEDAN].length_m == pytest.approx(2.0, abs=0.4)
    ego = lab.view_of(lab.world_of(network, lab.L3), traffic).ego(0)
    assert (pull_over_path(replace(UNIT, side=1, emv_waits_steps=30), ego, 3) is not None) is goes


def driven(lab, world, s, speed, path, progress, *, left, degrees=0.0):
    """One step of a driver on a path of its own, at a place and at an angle to the lane."""
    unit = replace(UNIT, phase=Mode.YIELD_PULL_OVER)
    navigator = replace(NavigatorState().following(path, 80.0, 0.0), progress_m=progress)
    poses = np.array([[20.0, 0.0, 0.0, 8.0], [s, left, np.radians(degrees), speed]])
    view = lab.view_in(world, [emv_at(lab, 20.0), lab.Car(2, 0, s, speed, (0,))], poses=poses)
    return pull_over(replace(unit, navigator=navigator), view.ego(1), NEAR)


@pytest.mark.parametrize(("left_m", "extended"), [(0.9, True), (1.1, False)])
def test_at_the_edge_and_not_straight_yet_the_path_goes_on_a_metre_before_its_end(lab, world, left_m, extended):
    path = pull_over_path(UNIT, lab.view_in(world, [emv_at(lab), lab.Car(2, 0, 80, 3, (0,))]).ego(1), 0)
    progress = path.length_m - left_m
    s = float(path.curve.points[-1, 0]) - left_m
    outcome = driven(lab, world, s, 2.0, path, progress, left=-0.735, degrees=-5.0)
    assert outcome.unit.phase is Mode.YIELD_PULL_OVER
    assert (outcome.unit.navigator.path is not path) is extended


@pytest.mark.parametrize("speed", [2.0, 3.0])
def test_on_a_way_with_a_straight_piece_at_its_end_the_driver_goes_at_the_papers_speed(lab, world, speed):
    """On one that is only as long as the lateral move the driver creeps."""
    path = pull_over_path(UNIT, lab.view_in(world, [emv_at(lab), lab.Car(2, 0, 80, speed, (0,))]).ego(1), 0)
    assert path.length_m - path.settled_m > 1.0
    start = path.curve.points[0]
    command = driven(lab, world, float(start[0]), speed, path, 0.0, left=0.0).command
    assert command.throttle > 0.0
    short = replace(path, settled_m=path.length_m - 0.4)
    command = driven(lab, world, float(start[0]), speed, short, 0.0, left=0.0).command
    assert command.throttle == 0.0
    assert command.brake > 0.0


CAR, RIDER = 2, 3
RIDERS = (ActorClass.BICYCLE, ActorClass.MOTORCYCLE)
HALF_WIDTH_M = 0.5 * lab.vehicles[ActorClass.SEDAN].width_m


def lengths_m(kind):
    return 0.5 * (lab.vehicles[ActorClass.SEDAN].length_m + lab.vehicles[kind].length_m)


@pytest.mark.parametrize("side", [1, -1])
@pytest.mark.parametrize("turn", np.radians([130.0]))
@pytest.mark.parametrize("kind", [*RIDERS, ActorClass.HATCHBACK])
@pytest.mark.parametrize(
    ("beyond_m", "gap_m", "speed_mps", "turned_deg", "waits"),
    [
        *[(0.1, 1.4, 3.5, 0.0, True), (0.1, 1.6, 3.5, 0.0, False), (0.1, -1.0, 1.0, 0.0, True)],
        *[(0.1, 0.1, 2.9, 0.0, False), (0.1, -30.0, 3.5, 0.0, False), (0.69, 0.5, 3.5, 0.0, True)],
        *[(0.71, 0.5, 3.5, 0.0, False), (-1.0, 0.5, 3.5, 0.0, False), (0.1, 0.5, 3.5, 180.0, False)],
    ],
)
def test_riders_count_who_are_beside_or_come_up_on_the_side_of_the_move(
    side, turn, kind, beyond_m, gap_m, speed_mps, turned_deg, waits
):
    """The car, at 3 m/s, moves 0.4 m to a side; the rider's flank is ``beyond_m`` from its own, behind its rear."""
    network, along, across = lab.turned_road(turn)
    cars = [lab.Car(CAR, 0, 100, 5, (0,)), lab.Car(RIDER, 0, 90, 5, (0,), kind)]
    aside_m = side * (HALF_WIDTH_M + beyond_m + 0.5 * lab.vehicles[kind].width_m)
    point = 100.0 * along - (lengths_m(kind) + gap_m) * along + aside_m * across
    poses = np.array([[*(100.0 * along), turn, 3.0], [*point, turn + np.radians(turned_deg), speed_mps]])
    ego = lab.view(network, lab.L3, cars, poses=poses).ego(0)
    assert rider_comes_up(ego, side, 0.4) is (waits and kind in RIDERS)
    assert not rider_comes_up(ego, -side, 0.4)


def scene(kind, behind_m, speed_mps, left_m=-1.4):
    cars = [lab.Car(CAR, 0, 100, 5.0, (0,)), lab.Car(RIDER, 0, 100 - behind_m, speed_mps, (0,), kind, left=left_m)]
    return lab.view(lab.straight_road(1), lab.L3, cars).ego(0)


@pytest.mark.parametrize("kind", RIDERS)
def test_a_driver_lets_a_rider_pass_before_pulling_over(kind):
    reacting = replace(UNIT, phase=Mode.YIELD_REACTING, side=0)
    waits = start_pull_over(reacting, scene(kind, 5.0, 7.0))
    assert (waits.unit.phase, waits.unit.side, waits.command) == (Mode.YIELD_DEFERRED, -1, None)
    assert waits.unit.deferred == "vehicle_beside"
    assert start_pull_over(waits.unit, scene(kind, -1.0, 7.0)).unit.phase is Mode.YIELD_DEFERRED
    for ego in (scene(kind, -8.0, 7.0), scene(kind, 40.0, 7.0), scene(kind, 5.0, 7.0, left_m=1.4)):
        assert start_pull_over(waits.unit, ego).unit.phase is Mode.YIELD_PULL_OVER


@pytest.mark.parametrize("speed_mps", [4.0, 6.0, 8.0])
@pytest.mark.parametrize("kind", RIDERS)
def test_a_rider_who_pulls_over_leans_no_more_than_drivers_like(kind, speed_mps):
    """Its wheels turn at once: the move is as long as the speed at its begin asks for."""
    ego = lab.view(lab.straight_road(1), lab.L3, [lab.Car(CAR, 0, 100, speed_mps, (0,), kind)]).ego(0)
    path = pull_over_path(replace(UNIT, side=-1), ego, 0)
    aside = speed_mps**2 * np.abs(path.curve.curvature_1pm).max()
    assert 0.5 * ego.navigator_config.lateral_accel_mps2 < aside < 1.1 * ego.navigator_config.lateral_accel_mps2
