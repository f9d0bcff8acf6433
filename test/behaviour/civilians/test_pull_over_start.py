"""When and where a civilian's pull-over at L3 starts, and to which side."""

from dataclasses import replace

import pytest
from behaviour.civilians.pull_over_steps import UNIT, emv_at, kinds, shoulder_road, steps

from siren_ros.behaviour.civilians.pull_over import alignment_of, pull_over_path, start_pull_over
from siren_ros.world.actors import ActorClass, Mode, Owner

AMBULANCE = ActorClass.AMBULANCE


@pytest.mark.parametrize(
    ("lanes", "shoulder", "expected"),
    [(1, False, [-1]), (2, False, [-1, 1]), (3, False, [-1, -1, 1]), (3, True, [-1, -1, 1]), (2, True, [-1, -1])],
)
def test_leftmost_lane_goes_left_all_others_right(lab, lanes, shoulder, expected):
    network = lab.straight_road(lanes, shoulder=shoulder)
    view = lab.view(network, lab.L3, [emv_at(lab)])
    assert [alignment_of(view.network, lane) for lane in range(lanes)] == expected


def test_everybody_before_the_turn_goes_left_where_the_emv_comes_on_the_shoulder(lab):
    world = shoulder_road(lab)

    def sides(emv_route):
        cars = [
            lab.Car(1, 1, 40, 8, emv_route, AMBULANCE),
            lab.Car(2, 1, 75, 5, (0, 2)),
            lab.Car(3, 2, 75, 5, (0, 2)),
            lab.Car(4, 4, 20, 5, (1,)),
        ]
        state, _, _ = steps(lab, world, cars, 30)
        return {actor: unit.side for actor, unit in state.units.items() if unit.phase is Mode.YIELD_PULL_OVER}

    assert sides((0, 1)) == {2: 1, 3: 1}
    assert sides((0, 2)) == {2: -1, 3: 1}


def test_every_lane_of_the_road_pulls_over(lab, world):
    cars = [emv_at(lab), lab.Car(2, 0, 80, 5, (0,)), lab.Car(3, 1, 80, 5, (0,))]
    _, commands, events = steps(lab, world, cars)
    assert kinds(events) == ["yield_requested", "yield_requested", "yield_started", "yield_started"]
    assert commands.mode.tolist() == [Mode.YIELD_PULL_OVER] * 2
    assert commands.owner.tolist() == [Owner.ROS] * 2
    assert [event.detail["side"] for event in events[2:]] == [-1, 1]


def test_not_on_a_junction(lab):
    network = lab.junction_road()
    world = lab.world_of(network, lab.L3)
    cars = [lab.Car(1, 0, 135, 8, (0, 2), AMBULANCE), lab.Car(2, 2, 10, 5, (0, 2))]
    _, commands, events = steps(lab, world, cars)
    assert kinds(events) == ["yield_requested", "yield_deferred"]
    assert events[1].detail["reason"] == "junction"
    assert commands.owner.tolist() == [Owner.SUMO]


def joined_road(lab, *, oncoming_turns=False):
    """Two lanes, a path of 30 m over a junction, two lanes; the oncoming traffic of some turns left across it."""
    road = lab.RoadBuilder()
    road.edge([[0, 0], [100, 0]], 2, ("W", "J"))
    road.edge([[100, 0], [130, 0]], 2, ("J", "J"), internal=True)
    road.edge([[130, 0], [300, 0]], 2, ("J", "E"))
    road.connect(0, 4, via=(2,))
    road.connect(1, 5, via=(3,))
    if oncoming_turns:
        road.edge([[300, 10], [130, 10]], 1, ("E", "J"))
        road.edge([[130, 10], [115, -20]], 1, ("J", "J"), internal=True)
        road.edge([[115, -20], [115, -100]], 1, ("J", "S"))
        road.connect(6, 8, via=(7,), direction="l")
    return road.built()


@pytest.mark.parametrize("crossed", [False, True])
def test_pulls_over_on_a_junction_that_nobody_crosses(lab, crossed):
    network = joined_road(lab, oncoming_turns=crossed)
    world = lab.world_of(network, lab.L3)
    cars = [
        lab.Car(1, 0, 90, 8, (0, 2), AMBULANCE),
        lab.Car(2, 2, 15, 3, (0, 2)),
        lab.Car(3, 3, 15, 3, (0, 2)),
    ]
    state, _, events = steps(lab, world, cars, 40)
    wanted = "yield_deferred" if crossed else "yield_started"
    assert [event.actor_id for event in events if event.kind.value == wanted] == [2, 3]
    assert [state.units[actor].side for actor in (2, 3)] == ([0, 0] if crossed else [-1, 1])


@pytest.mark.parametrize(("ahead", "yields"), [(0.1, True), (-0.1, False)])
def test_a_vehicle_at_the_emvs_side_pulls_over_where_its_front_is_ahead_of_the_emvs(lab, world, ahead, yields):
    front = 50.0 + 0.5 * lab.vehicles[AMBULANCE].length_m
    centre = front + ahead - 0.5 * lab.vehicles[ActorClass.SEDAN].length_m
    _, commands, events = steps(lab, world, [emv_at(lab), lab.Car(2, 1, centre, 5, (0,))])
    assert (kinds(events) == ["yield_requested", "yield_started"]) is yields
    assert (commands.actor_id.tolist() == [2]) is yields


def test_a_pull_over_is_deferred_where_the_vehicle_cannot_stop_before_the_junction(lab):
    network = lab.junction_road()
    world = lab.world_of(network, lab.L3)
    for speed, events in ((3.0, ["yield_requested", "yield_started"]), (12.0, ["yield_requested", "yield_deferred"])):
        cars = [lab.Car(1, 0, 115, 8, (0, 2), AMBULANCE), lab.Car(2, 0, 136, speed, (0, 2))]
        _, _, found = steps(lab, world, cars)
        assert kinds(found) == events


def test_a_queue_that_stands_too_close_waits_for_the_one_ahead(lab):
    cars = [emv_at(lab), lab.Car(2, 0, 80, 0, (0,)), lab.Car(3, 0, 87.25, 0, (0,))]
    _, _, events = steps(lab, lab.world_of(lab.straight_road(), lab.L3), cars, 10)
    mine = [event for event in events if event.actor_id == 2]
    assert kinds(mine) == ["yield_requested", "yield_deferred"]
    assert mine[1].detail["reason"] == "no_room"


def test_a_pull_over_starts_where_the_way_of_a_stop_is_no_longer_than_the_path_and_a_little(lab):
    """The path ends before the junction; from each place and speed the rule says whether it is long enough."""
    network = lab.junction_road()
    world = lab.world_of(network, lab.L3)
    brake = world.config.civilian_navigator.comfort_brake_mps2
    unit = replace(UNIT, phase=Mode.YIELD_REACTING, side=-1)
    verdicts = set()
    for s in (100.0, 115.0, 125.0, 132.0, 138.0):
        for speed in (6.0, 8.0, 9.0, 10.0, 11.0, 12.5):
            cars = [lab.Car(1, 0, 60, 8, (0, 2), AMBULANCE), lab.Car(2, 0, s, speed, (0, 2))]
            view = lab.view_of(world, lab.traffic_of(network, cars))
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
    cars = [emv_at(lab), lab.Car(2, 0, 80, speed, (0,))]
    view = lab.view_in(world, cars, step=step)
    outcome = start_pull_over(replace(UNIT, phase=Mode.YIELD_DEFERRED, deferred="no_room"), view.ego(1))
    assert (outcome.unit.phase is Mode.YIELD_PULL_OVER) is (looks or speed > 0.0)
