"""Sirens and brake lights of a fleet."""

import numpy as np
import pytest
from dynamics.fleet_scenes import PARAMETERS, begun, command_of, started, traffic_of

from siren_ros.dynamics.fleet import step_fleet
from siren_ros.world.actors import ActorClass, Lights
from siren_ros.world.traffic_state import EventKind


def test_a_siren_is_said_once_when_it_begins_and_ends() -> None:
    state, _ = started(2)
    rows = {1: (0.5, 50.0, 0.0, 10.0), 2: (0.5, 100.0, 0.0, 10.0)}
    sounding, silent = {1: Lights.SIREN, 2: Lights.SIREN}, {2: Lights.SIREN}
    said = []
    for step, lights in enumerate((sounding, sounding, silent), start=1):
        state, _, events = step_fleet(state, traffic_of(step, rows, lights=lights), ())
        said += [(event.step, event.kind, event.actor_id) for event in events]
    state, _, events = step_fleet(state, traffic_of(4, {1: rows[1]}, removed=[2]), ())
    assert said == [(1, EventKind.SIREN_ON, 1), (1, EventKind.SIREN_ON, 2), (3, EventKind.SIREN_OFF, 1)]
    assert [(event.kind, event.actor_id) for event in events] == [(EventKind.REMOVED, 2), (EventKind.SIREN_OFF, 2)]
    assert [event.y_m for event in events] == pytest.approx([100.0, 100.0])
    state, _, events = step_fleet(state, traffic_of(5, {1: rows[1]}), ())
    assert events == ()


def test_the_brake_light_is_the_vehicles_own() -> None:
    state, states = started(1, 10.0)
    traffic = traffic_of(1, {1: (0.5, 50.0, 0.0, 10.0)})
    _, braked, _ = step_fleet(state, traffic, [command_of(1, 1, brake=0.5, lights=Lights.SIREN)])
    assert braked.lights[0] == Lights.SIREN | Lights.BRAKE
    assert braked.brake[0] > 0.02
    assert states.lights[0] == Lights.NONE


@pytest.mark.parametrize(("brake", "accel", "lit"), [(0.0, -1.2, False), (0.0, -1.4, True), (0.5, 0.0, True)])
def test_the_brake_light_shows_the_pedal_or_the_deceleration(brake: float, accel: float, lit: bool) -> None:
    """Decelerations by drag alone: a command without a brake from a speed at which drag gives them."""
    vehicle = PARAMETERS[ActorClass.SEDAN]
    speed = np.sqrt(-accel * vehicle.mass_kg / (0.5 * 1.225 * vehicle.drag_area_m2)) if accel else 10.0
    rolling = vehicle.rolling_resistance * 9.80665 * vehicle.mass_kg / (0.5 * 1.225 * vehicle.drag_area_m2)
    speed = float(np.sqrt(max(speed**2 - rolling, 1.0)))
    state, _ = begun((0.0, 0.0, 0.0, speed))
    _, states, _ = step_fleet(state, traffic_of(1, {1: (0.0, 0.0, 0.0, speed)}), [command_of(1, 1, brake=brake)])
    assert bool(states.lights[0] & Lights.BRAKE) is lit
