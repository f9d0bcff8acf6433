"""Vehicles that touch: one event, and both stop and stay."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from dynamics.fleet_scenes import PARAMETERS, begun, command_of, description, kinds, started, traffic_of

from siren_ros.base.numerics.units import STEP_S
from siren_ros.simulation.dynamics.fleet import FleetState, step_fleet
from siren_ros.simulation.world.actors import ActorClass, ActorDescription, Lights, Mode, Owner
from siren_ros.simulation.world.traffic_state import Event, EventKind, TrafficState


def test_collisions_become_events_once() -> None:
    state, states = begun((0.0, 0.0, 0.0, 10.0), (12.0, 0.0, 0.0, 0.0))
    collisions: list[Event] = []
    for step in range(1, 60):
        rows = {1: (float(states.x_m[0]), 0.0, 0.0, float(states.speed_mps[0])), 2: (12.0, 0.0, 0.0, 0.0)}
        state, states, events = step_fleet(state, traffic_of(step, rows), [command_of(step, 1, throttle=0.05)])
        collisions += [event for event in events if event.kind is EventKind.COLLISION]
        if states.x_m[0] > 11.0:
            break
    (event,) = collisions
    assert (event.actor_id, event.other_id) == (1, 2)
    gap = 12.0 - PARAMETERS[ActorClass.SEDAN].length_m
    assert event.step == pytest.approx(gap / 10.0 / STEP_S, abs=1.5)
    assert event.detail["impact_speed_mps"] == pytest.approx(10.0, abs=0.3)
    assert event.x_m == pytest.approx(12.0 - PARAMETERS[ActorClass.SEDAN].length_m / 2.0, abs=0.4)


@pytest.mark.parametrize("yaw", np.radians([0.0, 30.0, 60.0, 200.0]))
def test_who_was_in_contact_stops_and_stays(yaw: float) -> None:
    way = np.array([np.cos(yaw), np.sin(yaw)])

    def traffic(step: int, spawned: Sequence[ActorDescription] = ()) -> TrafficState:
        """SUMO lets one car drive through another one that stands."""
        places = {1: (12.0 * STEP_S * step * way, 12.0), 2: (15.0 * way, 0.0)}
        return traffic_of(step, {i: (*place, yaw, speed) for i, (place, speed) in places.items()}, spawned)

    state, states, _ = step_fleet(FleetState.empty(PARAMETERS), traffic(0, [description(1), description(2)]), ())
    collisions: list[Event] = []
    for step in range(1, 120):
        state, states, events = step_fleet(state, traffic(step), ())
        collisions += [event for event in events if event.kind is EventKind.COLLISION]
        apart = (states.x_m[1] - states.x_m[0]) * way[0] + (states.y_m[1] - states.y_m[0]) * way[1]
        assert apart > PARAMETERS[ActorClass.SEDAN].length_m - 0.05
    (collision,) = collisions
    assert collision.detail["impact_speed_mps"] == pytest.approx(12.0, abs=0.2)
    assert states.speed_mps == pytest.approx([0.0, 0.0], abs=1e-3)
    assert states.owner.tolist() == [Owner.ROS, Owner.ROS]
    assert states.mode.tolist() == [Mode.STOPPED, Mode.STOPPED]
    hazard = Lights.INDICATOR_LEFT | Lights.INDICATOR_RIGHT
    assert np.all(states.lights & hazard == hazard)
    assert states.residual_m.tolist() == [0.0, 0.0]


def test_commands_cannot_move_who_was_in_contact() -> None:
    state, _ = started()
    state = replace(state, stopped=(1,))
    speed = []
    for step in range(1, 80):
        traffic = traffic_of(step, {1: (0.5 * step, 50.0, 0.0, 10.0)})
        state, states, _ = step_fleet(state, traffic, [command_of(step, 1, throttle=1.0, steer=0.3)])
        speed.append(float(states.speed_mps[0]))
    assert speed[-1] == 0.0
    assert states.throttle[0] < 1e-3


def test_after_a_contact_the_velocity_is_the_one_that_the_contact_left() -> None:
    length = PARAMETERS[ActorClass.SEDAN].length_m
    standing = (length + 0.3, 0.0, 0.0, 0.0)
    state, _ = begun((0.0, 0.0, 0.0, 10.0), standing)
    state, states, events = step_fleet(state, traffic_of(1, {1: (0.5, 0.0, 0.0, 10.0), 2: standing}), ())
    assert EventKind.COLLISION in kinds(events)
    vx, vy = state.bodies.velocity_mps(state.table)
    assert (states.vx_mps.tolist(), states.vy_mps.tolist()) == (vx.tolist(), vy.tolist())
    assert states.vx_mps == pytest.approx([5.0, 5.0], abs=0.3), "equal masses that stay together"
