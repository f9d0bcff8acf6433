"""When a civilian at L3 holds at the end of its pull-over, when it goes on, and how it is released."""

from dataclasses import replace

import numpy as np
import pytest
from behaviour.civilians.civilian_steps import NEAR, UNIT, emv_at, steps
from behaviour.lab import kinds

from siren_ros.simulation.behaviour.civilians.pull_over import edge_offset_m, hold, pull_over, pull_over_path
from siren_ros.simulation.behaviour.driving.driver_states import aligned_within_rad
from siren_ros.simulation.behaviour.driving.navigator import NavigatorState
from siren_ros.simulation.world.actors import ActorClass, Lights, Mode, Owner

AMBULANCE = ActorClass.AMBULANCE


def test_holds_with_full_brake_and_hand_brake_when_reached_and_aligned(lab, world):
    cars = [emv_at(lab), lab.Car(2, 0, 80, 5, (0,))]
    state, _, _ = steps(world, cars)
    state, commands, events = steps(world, [cars[0], lab.Car(2, 0, 90, 0, (0,), left=-0.735)], 1, state, 1)
    assert (kinds(events), events[0].detail["partial"]) == (["yield_held"], 0)
    assert commands.mode.tolist() == [Mode.YIELD_HOLD]
    assert (commands.brake[0], commands.throttle[0], commands.hand_brake[0]) == (1.0, 0.0, 1)


def test_who_reaches_the_edge_in_motion_brakes_as_people_do_and_then_stands_with_the_hand_brake(lab):
    cars = [lab.Car(1, 0, 40, 8, (0,), AMBULANCE), lab.Car(2, 0, 80, 7, (0,), desired=7.0)]
    loop = lab.Loop(lab.world_of(lab.straight_road(), lab.L3), cars).run(200)
    speed = np.array([row[2][3] for row in loop.log])
    (held,) = [event for event in loop.of("yield_held") if event.actor_id == 2]
    assert speed[held.step] > 2.0, "it moves as it begins to hold"
    assert np.diff(speed).min() / 0.05 > -3.5
    assert speed[held.step + 60] == pytest.approx(0.0, abs=0.01)


def test_a_driver_who_brakes_to_the_hold_keeps_clear_of_who_stands_ahead(lab, world):
    """The edge is reached at 3 m/s, with a standing vehicle 1.5 m ahead: more than a comfortable stop is needed."""
    unit = replace(UNIT, navigator=NavigatorState())
    length = lab.vehicles[ActorClass.SEDAN].length_m
    near, far = (
        lab.view_in(world, [emv_at(lab), lab.Car(2, 0, 80, 3.0, (0,)), lab.Car(3, 0, 80 + length + gap, 0, (0,))])
        for gap in (1.5, 30.0)
    )
    path = pull_over_path(replace(UNIT, side=-1), far.ego(1), 0)
    unit = replace(UNIT, navigator=NavigatorState().following(path, 80.0, 0.0))
    brakes = [hold(unit, view.ego(1), NEAR).command.brake for view in (near, far)]
    assert brakes[0] > 1.3 * brakes[1] > 0.0


def behind_a_standing_vehicle(lab, world):
    """The state after the first step, and the vehicles where the civilian comes no farther."""
    emv, ahead = emv_at(lab), lab.Car(3, 0, 89.0, 0, (0,))
    state, _, _ = steps(world, [emv, lab.Car(2, 0, 80, 0, (0,)), ahead])
    return state, [emv, lab.Car(2, 0, 83.2, 0, (0,), left=-0.2), ahead]


def test_partial_hold_behind_a_standing_vehicle_goes_on_when_the_way_is_free(lab, world):
    state, stuck = behind_a_standing_vehicle(lab, world)
    state, _, events = steps(world, stuck, 25, state, 1)
    held = [event for event in events if event.kind.value == "yield_held" and event.actor_id == 2]
    assert [event.detail["partial"] for event in held] == [1]
    state, commands, _ = steps(world, [*stuck[:2], lab.Car(3, 0, 110, 0, (0,))], 12, state, 26)
    assert dict(zip(commands.actor_id.tolist(), commands.mode.tolist(), strict=True))[2] == Mode.YIELD_PULL_OVER


def test_a_long_vehicle_has_to_stand_straighter_than_a_car(lab, straight):
    view = lab.view(straight, lab.L3, [lab.Car(2, 0, 80, 0, (0,)), lab.Car(3, 0, 120, 0, (0,), ActorClass.BUS)], 0)
    car, bus = (aligned_within_rad(view.ego(row)) for row in range(2))
    assert car == pytest.approx(np.radians(8.0), rel=0.05)
    assert np.sin(bus) * view.seen.half_length_m[1] < 0.35
    assert bus < 0.5 * car


def test_the_standstill_before_a_partial_hold_is_counted_without_interruption(lab, world):
    state, stuck = behind_a_standing_vehicle(lab, world)
    rolling = [stuck[0], replace(stuck[1], speed=0.5), stuck[2]]
    needed = round(world.config.civilian_driver.pull_over.blocked_hold_s / 0.05)
    state, _, _ = steps(world, stuck, needed - 1, state, 1)
    state, _, _ = steps(world, rolling, 1, state, needed)
    state, _, events = steps(world, stuck, needed - 1, state, needed + 1)
    assert not [event for event in events if event.actor_id == 2]
    _, _, events = steps(world, stuck, 1, state, 2 * needed)
    assert [event.kind.value for event in events if event.actor_id == 2] == ["yield_held"]


def goes_on_after(lab, world, *phases):
    """Step at which a driver who holds goes on to make room: the EMV behind stands or rolls for some steps each."""
    car = lab.Car(2, 0, 80, 5, (0,))
    held = lab.Car(2, 0, 90, 0, (0,), left=-0.735)
    state, _, _ = steps(world, [lab.Car(1, 0, 72, 8, (0,), AMBULANCE), car])
    step = 1
    for speed, count in phases:
        for _ in range(count):
            state, commands, _ = steps(world, [lab.Car(1, 0, 72, speed, (0,), AMBULANCE), held], 1, state, step)
            if step > 1 and commands.mode.tolist() == [Mode.YIELD_PULL_OVER]:
                return step
            step += 1
    return None


def test_room_is_made_when_the_emv_has_stood_behind_without_interruption(lab, world):
    """For 1.5 s; the driver looks again every half a second."""
    assert goes_on_after(lab, world, (0.0, 45)) == 32
    assert goes_on_after(lab, world, (5.0, 60)) is None
    assert goes_on_after(lab, world, (0.0, 20), (5.0, 1), (0.0, 30)) is None
    assert goes_on_after(lab, world, (0.0, 20), (5.0, 1), (0.0, 45)) == 52


def test_comes_straight_before_it_holds(lab, world):
    """At the edge with 5°, which the paper accepts, the driver goes on until the vehicle is straight or has to stop.

    It does not hold while the heading is off by more than eight degrees.
    """
    cars = [emv_at(lab), lab.Car(2, 0, 80, 5, (0,))]
    state, _, _ = steps(world, cars)
    on_the_way = [((86.0, -0.72), 5.0, 2.0, False), ((86.0, -0.72), 2.0, 2.0, True), ((86.0, -0.72), 5.0, 0.0, True)]
    for place, degrees, speed, held in [
        *on_the_way,
        ((90.0, -0.735), 9.0, 0.1, False),
        ((90.0, -0.735), 7.0, 0.1, True),
    ]:
        poses = np.array([[50.0, 0.0, 0.0, 8.0], [*place, -np.radians(degrees), speed]])
        assert ("yield_held" in kinds(steps(world, cars, 1, state, 1, poses=poses)[2])) is held


def test_who_goes_on_after_a_partial_hold_counts_its_standstill_anew(lab, world):
    """Nothing of the hold is left: a driver who then stands for a moment does not hold at once."""
    cars = [emv_at(lab), lab.Car(2, 0, 83.2, 0, (0,), left=-0.2), lab.Car(3, 0, 110, 0, (0,))]
    view = lab.view_in(world, cars, step=2)
    held = replace(UNIT, partial=True, stopped_steps=25)
    gone = hold(held, view.ego(1), NEAR).unit
    assert gone.phase is Mode.YIELD_PULL_OVER
    assert (gone.partial, gone.stopped_steps) == (False, 0)
    assert gone.navigator.path is not None
    later = lab.view_in(world, cars, step=3)
    assert hold(held, later.ego(1), NEAR).unit.phase is Mode.YIELD_HOLD, "it looks again each ten steps"


@pytest.mark.parametrize(("lane", "side"), [(0, -1), (1, 1)])
@pytest.mark.parametrize(
    ("progress", "miss", "holds"),
    [(0.0, 0.04, True), (0.0, 0.06, False), (0.45, 0.14, True), (0.45, 0.16, False), (0.55, 0.14, False)],
)
def test_the_edge_counts_as_reached_within_5_cm_and_within_15_cm_where_the_lateral_move_ends(
    lab, world, lane, side, progress, miss, holds
):
    """``progress`` is the way that is left of the lateral move (0: all of it); half a metre counts as none."""
    car = lab.Car(2, lane, 80, 3.0, (0,))
    start = lab.view_in(world, [emv_at(lab), car])
    unit = replace(UNIT, side=side, phase=Mode.YIELD_PULL_OVER)
    path = pull_over_path(unit, start.ego(1), lane)
    done = path.settled_m - progress if progress else 2.0
    unit = replace(unit, navigator=replace(NavigatorState().following(path, 80.0, 3.3 * lane), progress_m=done))
    edge = edge_offset_m(start.ego(1), lane, side)
    view = lab.view_in(world, [emv_at(lab), replace(car, s=80.0 + done, left=edge - side * miss)], step=1)
    outcome = pull_over(unit, view.ego(1), NEAR)
    assert (outcome.unit.phase is Mode.YIELD_HOLD) is holds
    if holds:
        (event,) = outcome.events
        assert (event.detail["side"], event.detail["partial"]) == (side, 0)
        assert event.detail["offset_m"] == pytest.approx(edge - side * miss, abs=1e-6)


def holding(lab, world):
    """The state in which the civilian holds at the right edge, and the civilian."""
    held = lab.Car(2, 0, 90, 0, (0,), left=-0.735)
    state, _, _ = steps(world, [emv_at(lab), lab.Car(2, 0, 80, 5, (0,))])
    return steps(world, [emv_at(lab), held], 1, state, 1)[0], held


def test_released_from_the_hold_by_way_of_the_lane(lab, world):
    state, held = holding(lab, world)
    state, commands, events = steps(world, [emv_at(lab, 98.0), held], 1, state, 2)
    assert (commands.mode.tolist(), commands.owner.tolist()) == ([Mode.REJOIN], [Owner.ROS])
    assert not events
    state, commands, events = steps(world, [emv_at(lab, 120.0), lab.Car(2, 0, 100, 4, (0,))], 1, state, 3)
    assert kinds(events) == ["yield_released"]
    assert len(commands) == 0


def test_stays_where_it_stands_until_nobody_is_in_its_way_back(lab, world):
    """SUMO, which does not look, would drive it into the vehicle ahead."""
    cars = [emv_at(lab), lab.Car(2, 0, 80, 5, (0,))]
    state, _, _ = steps(world, cars)
    held = [lab.Car(2, 0, 90, 0, (0,), left=-0.735), lab.Car(3, 0, 96, 0, (0,))]
    known = lab.traffic_of(world.network, held, step=1).spawned
    state = replace(state, actors=state.actors.of({**state.actors.by_id, **{a.actor_id: a for a in known}}))
    state, _, _ = steps(world, [cars[0], *held], 1, state, 1)
    state, commands, events = steps(world, [emv_at(lab, 110.0), *held], 45, state, 2)
    assert kinds([event for event in events if event.actor_id == 2]) == []
    assert 2 in commands.actor_id.tolist()
    gone = [held[0], lab.Car(3, 0, 140, 5, (0,))]
    _, commands, events = steps(world, [emv_at(lab, 150.0), *gone], 45, state, 47)
    assert kinds([event for event in events if event.actor_id == 2]) == ["yield_released"]
    assert 2 not in commands.actor_id.tolist()


@pytest.mark.parametrize(
    ("lane", "left", "light"),
    [(0, -0.735, Lights.INDICATOR_LEFT), (1, 0.735, Lights.INDICATOR_RIGHT)],
    ids=["at the right edge", "at the left edge"],
)
def test_a_held_vehicle_is_released_when_the_emv_has_gone_elsewhere(lab, world, lane, left, light):
    """It leaves its edge towards the middle of its lane, and shows that side."""
    car = lab.Car(2, lane, 90, 0, (0,), left=left)
    state, commands, _ = steps(world, [emv_at(lab), replace(car, s=80.0, left=0.0, speed=5.0)])
    assert commands.lights.tolist() == [Lights.INDICATOR_RIGHT if left < 0.0 else Lights.INDICATOR_LEFT]
    state, commands, _ = steps(world, [emv_at(lab), car], 1, state, 1)
    assert commands.mode.tolist() == [Mode.YIELD_HOLD]
    state, commands, events = steps(world, [emv_at(lab, 36.0), car], 5, state, 2)
    assert commands.mode.tolist() == [Mode.YIELD_HOLD]
    assert not events
    _, commands, events = steps(world, [emv_at(lab, 30.0), car], 1, state, 7)
    assert (kinds(events), events[0].detail["reason"]) == (["yield_cancelled"], "emv_gone")
    assert (commands.mode.tolist(), commands.lights.tolist()) == ([Mode.REJOIN], [light])
    assert commands.throttle[0] > 0.0
    assert (commands.hand_brake.tolist(), np.sign(commands.steer_rad[0])) == ([0], -np.sign(left))


@pytest.mark.parametrize(("ahead_m", "speed", "released"), [(10.0, 2.9, False), (10.0, 3.1, True), (20.5, 0.0, True)])
def test_nobody_drives_on_past_an_emv_that_crawls_right_ahead(lab, world, ahead_m, speed, released):
    state, held = holding(lab, world)
    emv = lab.Car(1, 0, 90.0 + ahead_m, speed, (0,), AMBULANCE)
    _, commands, _ = steps(world, [emv, held], 1, state, 2)
    assert commands.mode.tolist() == [Mode.REJOIN if released else Mode.YIELD_HOLD]


def test_a_held_vehicle_is_released_when_the_emv_has_left_the_simulation(lab, world):
    state, held = holding(lab, world)
    _, commands, events = steps(world, [held], 1, state, 2)
    assert [event.detail["reason"] for event in events] == ["emv_gone"]
    assert commands.mode.tolist() == [Mode.REJOIN]


@pytest.mark.parametrize(
    ("passed", "in_region", "phase", "events"),
    [
        *[(True, True, Mode.YIELD_HOLD, []), (True, False, Mode.YIELD_HOLD, [])],
        *[(False, False, Mode.YIELD_HOLD, ["emv_gone"]), (True, True, Mode.YIELD_PULL_OVER, ["emv_passed"])],
        (False, False, Mode.YIELD_PULL_OVER, ["emv_gone"]),
    ],
)
def test_a_yield_without_a_hold_or_whose_emv_is_gone_is_cancelled(lab, world, passed, in_region, phase, events):
    view = lab.view_in(world, [emv_at(lab), lab.Car(2, 0, 90, 0, (0,), left=-0.735)])
    emv = replace(NEAR, passed=passed, in_region=in_region)
    outcome = (hold if phase is Mode.YIELD_HOLD else pull_over)(replace(UNIT, phase=phase), view.ego(1), emv)
    assert outcome.unit.phase is Mode.REJOIN
    assert [event.detail["reason"] for event in outcome.events] == events
