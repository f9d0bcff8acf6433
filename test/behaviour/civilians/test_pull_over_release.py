"""How a civilian at L3 is released from its pull-over and from its hold."""

from dataclasses import replace

import numpy as np
import pytest
from behaviour.civilians.pull_over_steps import NEAR, UNIT, emv_at, kinds, steps

from siren_ros.behaviour.civilians.pull_over import hold, pull_over
from siren_ros.world.actors import ActorClass, Lights, Mode, Owner

AMBULANCE = ActorClass.AMBULANCE


def test_released_from_the_hold_by_way_of_the_lane(lab, world):
    cars = [emv_at(lab), lab.Car(2, 0, 80, 5, (0,))]
    state, _, _ = steps(lab, world, cars)
    held = lab.Car(2, 0, 90, 0, (0,), left=-0.735)
    state, _, _ = steps(lab, world, [cars[0], held], 1, state, 1)
    state, commands, events = steps(lab, world, [emv_at(lab, 98.0), held], 1, state, 2)
    assert commands.mode.tolist() == [Mode.REJOIN]
    assert commands.owner.tolist() == [Owner.ROS]
    assert not events
    state, commands, events = steps(lab, world, [emv_at(lab, 120.0), lab.Car(2, 0, 100, 4, (0,))], 1, state, 3)
    assert kinds(events) == ["yield_released"]
    assert len(commands) == 0


def test_takes_over_where_it_stands_when_the_way_back_is_blocked(lab, world):
    cars = [emv_at(lab), lab.Car(2, 0, 80, 5, (0,))]
    state, _, _ = steps(lab, world, cars)
    held = [lab.Car(2, 0, 90, 0, (0,), left=-0.735), lab.Car(3, 0, 96, 0, (0,))]
    known = lab.traffic_of(world.network, held, step=1).spawned
    state = replace(state, actors=state.actors.of({**state.actors.by_id, **{a.actor_id: a for a in known}}))
    state, _, _ = steps(lab, world, [cars[0], *held], 1, state, 1)
    _, commands, events = steps(lab, world, [emv_at(lab, 110.0), *held], 45, state, 2)
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
    state, commands, _ = steps(lab, world, [emv_at(lab), replace(car, s=80.0, left=0.0, speed=5.0)])
    before = Lights.INDICATOR_RIGHT if left < 0.0 else Lights.INDICATOR_LEFT
    assert commands.lights.tolist() == [before]
    state, commands, _ = steps(lab, world, [emv_at(lab), car], 1, state, 1)
    assert commands.mode.tolist() == [Mode.YIELD_HOLD]
    state, commands, events = steps(lab, world, [emv_at(lab, 36.0), car], 5, state, 2)
    assert commands.mode.tolist() == [Mode.YIELD_HOLD]
    assert not events
    _, commands, events = steps(lab, world, [emv_at(lab, 30.0), car], 1, state, 7)
    assert kinds(events) == ["yield_cancelled"]
    assert events[0].detail["reason"] == "emv_gone"
    assert commands.mode.tolist() == [Mode.REJOIN]
    assert commands.lights.tolist() == [light]
    assert commands.throttle[0] > 0.0
    assert commands.hand_brake.tolist() == [0]
    assert np.sign(commands.steer_rad[0]) == -np.sign(left)


def test_a_held_vehicle_is_released_when_the_emv_has_left_the_simulation(lab, world):
    cars = [emv_at(lab), lab.Car(2, 0, 80, 5, (0,))]
    state, _, _ = steps(lab, world, cars)
    held = lab.Car(2, 0, 90, 0, (0,), left=-0.735)
    state, _, _ = steps(lab, world, [cars[0], held], 1, state, 1)
    _, commands, events = steps(lab, world, [held], 1, state, 2)
    assert [event.detail["reason"] for event in events] == ["emv_gone"]
    assert commands.mode.tolist() == [Mode.REJOIN]


@pytest.mark.parametrize(
    ("passed", "in_region", "phase", "events"),
    [
        (True, True, Mode.YIELD_HOLD, []),
        (True, False, Mode.YIELD_HOLD, []),
        (False, False, Mode.YIELD_HOLD, ["emv_gone"]),
        (True, True, Mode.YIELD_PULL_OVER, ["emv_passed"]),
        (False, False, Mode.YIELD_PULL_OVER, ["emv_gone"]),
    ],
)
def test_a_yield_without_a_hold_or_whose_emv_is_gone_is_cancelled(lab, world, passed, in_region, phase, events):
    cars = [emv_at(lab), lab.Car(2, 0, 90, 0, (0,), left=-0.735)]
    view = lab.view_in(world, cars)
    emv = replace(NEAR, passed=passed, in_region=in_region)
    step = hold if phase is Mode.YIELD_HOLD else pull_over
    outcome = step(replace(UNIT, phase=phase), view.ego(1), emv)
    assert outcome.unit.phase is Mode.REJOIN
    assert [event.detail["reason"] for event in outcome.events] == events
