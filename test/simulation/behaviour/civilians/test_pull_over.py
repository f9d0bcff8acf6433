"""Civilians at L3 that stand in the way of a standing EMV."""

from dataclasses import replace

import numpy as np
import pytest
from behaviour.civilians.civilian_steps import UNIT, shoulder_road, steps
from behaviour.lab import kinds

from siren_ros.simulation.behaviour.civilians import pull_over
from siren_ros.simulation.roads.road_network import LaneKind
from siren_ros.simulation.world.actors import ActorClass, Mode
from siren_ros.simulation.world.traffic_state import SignalState

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
    assert pull_over.emv_waits_behind(view.ego(1), 0) is waits
    assert not pull_over.emv_waits_behind(view.ego(1), -1)


@pytest.mark.parametrize("turn", np.radians([0.0, 40.0, 100.0, -150.0]))
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
    assert pull_over.emv_waits_behind(lab.view(straight, lab.L3, cars, poses=poses).ego(1), 0) is waits


def test_room_is_made_after_the_emv_has_waited_for_a_while(lab):
    view = view_of(lab, lab.Car(1, 0, 100, 0, (0,), AMBULANCE), lab.Car(2, 0, 112, 0, (0,)))
    assert not pull_over.makes_room(replace(UNIT, emv_waits_steps=29), view)
    assert pull_over.makes_room(WAITED, view)


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
    assert pull_over.may_go_on(unit, view.ego(0), 0) is goes


def test_the_front_goes_over_the_stop_line_only_to_make_room_or_at_the_head_of_a_standing_queue(lab, junction):
    half = 0.5 * lab.vehicles[ActorClass.SEDAN].length_m
    red = (SignalState("J", "r"),)
    traffic = replace(lab.traffic_of(junction, [lab.Car(2, 1, 149.0 - half, 0, (0, 2))]), signals=red)
    view = lab.view_of(lab.world_of(junction, lab.L3), traffic)
    left, config = replace(UNIT, side=1), view.world.config.civilian_driver.pull_over
    for unit, over in ((left, config.head_over_line_m), (replace(left, emv_waits_steps=30), config.room_over_line_m)):
        front = pull_over.pull_over_path(unit, view.ego(0), 1).curve.points[-1, 0] + half
        assert 150.0 + 0.5 * over < front < 150.0 + over + 0.5
    rolling = view_of(lab, lab.Car(2, 1, 149.0 - half, 2.0, (0, 2)), network=junction)
    assert pull_over.pull_over_path(left, rolling.ego(0), 1) is None


def test_a_vehicle_beside_a_shoulder_stays_before_the_stop_line(lab):
    road = lab.RoadBuilder().edge([[0.0, 0.0], [150.0, 0.0]], 2, ("W", "J"), shoulder=True)
    road.edge([[150.0, 3.3], [175.0, 3.3]], 1, ("J", "J"), internal=True)
    road.edge([[175.0, 0.0], [400.0, 0.0]], 2, ("J", "E"), shoulder=True)
    road.connect(1, 4, via=(2,), signal=True)
    half = 0.5 * lab.vehicles[ActorClass.SEDAN].length_m
    view = view_of(lab, lab.Car(2, 1, 149.0 - half, 0, (0, 2)), network=road.built())
    assert pull_over.pull_over_path(WAITED, view.ego(0), 1) is None


@pytest.mark.parametrize("kind", [LaneKind.KERB, LaneKind.SIDEWALK])
def test_a_vehicle_beside_a_strip_that_nobody_uses_goes_over_the_stop_line(lab, kind):
    road = lab.RoadBuilder().edge([[0.0, 0.0], [150.0, 0.0]], 2, ("W", "J"), shoulder=True)
    road.edge([[150.0, 3.3], [175.0, 3.3]], 1, ("J", "J"), internal=True)
    road.edge([[175.0, 0.0], [400.0, 0.0]], 2, ("J", "E"), shoulder=True)
    road.connect(1, 4, via=(2,), signal=True)
    network = road.built()
    lanes = tuple(
        replace(lane, kind=kind, emergency_allowed=False) if lane.kind is LaneKind.SHOULDER else lane
        for lane in network.lanes
    )
    half = 0.5 * lab.vehicles[ActorClass.SEDAN].length_m
    view = view_of(lab, lab.Car(2, 1, 149.0 - half, 0, (0, 2)), network=replace(network, lanes=lanes))
    assert pull_over.pull_over_path(WAITED, view.ego(0), 1).curve.points[-1, 0] + half > 151.0


@pytest.mark.parametrize("unit", [UNIT, WAITED], ids=["at once", "an EMV waits"])
@pytest.mark.parametrize("speed", [0.0, 5.0])
def test_nobody_pulls_over_on_a_junction(lab, unit, speed):
    view = view_of(lab, lab.Car(2, 2, 5.0, speed, (0, 2)), network=lab.junction_road())
    outcome = pull_over.start_pull_over(unit, view.ego(0))
    assert outcome.unit.phase is Mode.YIELD_DEFERRED
    assert outcome.command is None


def test_a_queue_that_left_no_corridor_goes_on_until_the_emv_gets_through(lab):
    road = lab.straight_road(2)
    cars = [
        *[lab.Car(1, 0, 80, 6, (0,), AMBULANCE), lab.Car(2, 0, 108, 0, (0,), desired=0)],
        *[lab.Car(3, 0, 114.5, 0, (0,), desired=0), lab.Car(4, 1, 108, 0, (0,), desired=0)],
        lab.Car(5, 1, 114.5, 0, (0,), desired=0),
    ]
    loop = lab.Loop(lab.world_of(road, lab.L3), cars).run(900)
    assert loop.body.x_m[0] > 150.0
    assert min(row[actor][0] for row in loop.log[-1:] for actor in (2, 3, 4, 5)) > 110.0
    assert not loop.touching()


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
