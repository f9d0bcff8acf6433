"""People on foot: how they follow SUMO's, and what contacts do to them."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest
from dynamics.fleet_scenes import description, traffic_of

from siren_ros.base.numerics.units import STEP_S
from siren_ros.simulation.dynamics.fleet import FleetState, step_fleet
from siren_ros.simulation.dynamics.parameters import VehicleParameters
from siren_ros.simulation.dynamics.walkers import walk
from siren_ros.simulation.world.actors import ActorClass, ActorStates, Lights, Owner
from siren_ros.simulation.world.traffic_state import EventKind

ONE = np.array([True])


def walked(targets: list[tuple[float, float, float, float]], start: tuple[float, ...] = (0.0, 0.0, 0.0)) -> Any:
    """Columns of the body after each of SUMO's poses: x, y, yaw, speed; shape ``(steps, 11)``."""
    body = np.zeros((11, 1))
    body[:3, 0] = start
    rows = []
    for target in targets:
        after = np.zeros_like(body)
        walk(body, np.array([target]).T.copy(), ONE, STEP_S, after)
        body = after
        rows.append(body[:, 0])
    return np.array(rows)


def straight(steps: int, speed_mps: float = 1.3) -> list[tuple[float, float, float, float]]:
    return [(speed_mps * STEP_S * (step + 1), 0.0, 0.0, speed_mps) for step in range(steps)]


def test_a_steady_walk_is_followed_without_lag() -> None:
    body = walked(straight(100))
    assert body[-1, 0] == pytest.approx(1.3 * STEP_S * 100, abs=0.02)
    assert body[-1, 3] == pytest.approx(1.3, abs=0.02)
    assert np.abs(body[:, 1]).max() == 0.0


@pytest.mark.parametrize("aside_m", [0.65, -1.0])
def test_a_jump_aside_becomes_steps(aside_m: float) -> None:
    """No step is longer than the pace with haste allows, and the place is reached within two seconds."""
    targets = [(x, aside_m if step > 20 else 0.0, yaw, v) for step, (x, _, yaw, v) in enumerate(straight(80))]
    body = walked(targets)
    moved = np.hypot(*np.diff(body[:, :2], axis=0).T)
    assert moved.max() <= (1.3 + 0.8) * STEP_S + 1e-9
    assert body[60, 1] == pytest.approx(aside_m, abs=0.05)
    accel = np.hypot(*np.diff(np.diff(body[:, :2], axis=0), axis=0).T) / STEP_S**2
    assert accel.max() <= 2.5 + 1e-6


def test_speed_and_turn_rate_are_those_of_the_motion() -> None:
    targets = [(np.sin(0.04 * k), 1.0 - np.cos(0.04 * k), 0.04 * k, 0.8) for k in range(1, 120)]
    body = walked(targets)
    velocity = np.diff(body[:, :2], axis=0) / STEP_S
    cos, sin = np.cos(body[1:, 2]), np.sin(body[1:, 2])
    np.testing.assert_allclose(body[1:, 3] * cos - body[1:, 4] * sin, velocity[:, 0], atol=1e-9)
    np.testing.assert_allclose(body[1:, 3] * sin + body[1:, 4] * cos, velocity[:, 1], atol=1e-9)
    turned = np.diff(np.unwrap(body[:, 2])) / STEP_S
    np.testing.assert_allclose(body[1:, 5], turned, atol=1e-9)
    assert np.abs(turned).max() <= 4.0 + 1e-9


def test_who_stands_turns_to_where_sumos_person_looks() -> None:
    body = walked([(0.0, 0.0, 2.0, 0.0)] * 20)
    assert body[-1, 2] == pytest.approx(2.0)
    assert np.abs(body[:, :2]).max() == 0.0


def states_at(gap_m: float, parameters: Mapping[ActorClass, VehicleParameters], steps: int = 30) -> Any:
    """A sedan at 5 m/s towards somebody who stands, ``gap_m`` from the middle of one to that of the other."""
    state, found, events = FleetState.empty(parameters), [], []
    spawned = [description(1), description(2, ActorClass.PEDESTRIAN)]
    for step in range(steps):
        rows = {1: (5.0 * STEP_S * step, 0.0, 0.0, 5.0), 2: (gap_m, 0.0, np.pi, 0.0)}
        state, states, happened = step_fleet(state, traffic_of(step, rows, spawned if step == 0 else ()), ())
        found.append(states)
        events += happened
    return found, events


def test_people_follow_sumo_and_show_no_lights(parameters: Mapping[ActorClass, VehicleParameters]) -> None:
    found, events = states_at(40.0, parameters)
    last: ActorStates = found[-1]
    assert last.x_m[1] == 40.0
    assert last.residual_m[1] == 0.0
    assert (last.owner[1], last.lights[1]) == (Owner.SUMO, Lights.NONE)
    assert not [event for event in events if event.kind is EventKind.COLLISION]


def test_a_contact_stops_the_vehicle_and_not_the_person(parameters: Mapping[ActorClass, VehicleParameters]) -> None:
    found, events = states_at(6.0, parameters, steps=60)
    (contact,) = (event for event in events if event.kind is EventKind.COLLISION)
    assert (contact.actor_id, contact.other_id) == (1, 2)
    last: ActorStates = found[-1]
    assert last.speed_mps[0] == pytest.approx(0.0, abs=0.01)
    assert last.owner.tolist() == [Owner.ROS, Owner.SUMO]
    assert (last.x_m[1], last.y_m[1]) == (6.0, 0.0)


def test_people_who_pass_each_other_touch_nobody(parameters: Mapping[ActorClass, VehicleParameters]) -> None:
    state, events = FleetState.empty(parameters), []
    spawned = [description(number, ActorClass.PEDESTRIAN) for number in (1, 2)]
    for step in range(60):
        way = 1.3 * STEP_S * step
        rows = {1: (way, 0.0, 0.0, 1.3), 2: (4.0 - way, 0.1, np.pi, 1.3)}
        state, _, happened = step_fleet(state, traffic_of(step, rows, spawned if step == 0 else ()), ())
        events += happened
    assert not [event for event in events if event.kind is EventKind.COLLISION]
    assert state.stopped == ()
