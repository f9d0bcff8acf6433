"""What lies to the left and what turns counter-clockwise changes its sign; lights and wishes change sides."""

from dataclasses import fields

import numpy as np
import pytest

from siren_ros.simulation.world.actors import ACTOR_STATE_DTYPES, ActorStates, Lights
from siren_ros.simulation.world.commands import COMMAND_DTYPES, AvControl, VehicleCommands
from siren_ros.simulation.world.mirror_image import mirror_image
from siren_ros.simulation.world.traffic_state import (
    TRAFFIC_STATE_DTYPES,
    EmvAdvice,
    Event,
    EventKind,
    TrafficFlags,
    TrafficState,
)

EVENT = Event(3, EventKind.YIELD_HELD, 5, 1, 2.0, 7.0, {"side": -1, "offset_m": -1.5, "partial": 0, "reason": "x"})
ADVICE = EmvAdvice(1, 1, 5, 20.0, 9.0, 2)
SIGNED = {
    "y_m",
    "sumo_y_m",
    "yaw_rad",
    "sumo_yaw_rad",
    "vy_mps",
    "yaw_rate_radps",
    "lateral_accel_mps2",
    "steer_rad",
    "lateral_offset_m",
}
CODED = {"lights", "flags"}


def columns(dtypes):
    rng = np.random.default_rng(2)
    return {name: (rng.random(4) * 3.0 + 1.0).astype(dtype) for name, dtype in dtypes.items()}


STATES = ActorStates(step=4, **columns(ACTOR_STATE_DTYPES))
TRAFFIC = TrafficState(step=4, spawned=(), emvs=(ADVICE,), signals=(), events=(EVENT,), **columns(TRAFFIC_STATE_DTYPES))
COMMANDS = VehicleCommands(step=4, source="me", events=(EVENT,), **columns(COMMAND_DTYPES))


@pytest.mark.parametrize("content", [STATES, TRAFFIC, COMMANDS], ids=["states", "traffic", "commands"])
def test_every_column(content):
    image = mirror_image(content)
    for field in fields(content):
        before, after = getattr(content, field.name), getattr(image, field.name)
        if field.name in {"events", "emvs"}:
            assert after == tuple(map(mirror_image, before))
        elif field.name not in CODED:
            factor = -1.0 if field.name in SIGNED else 1.0
            assert np.array_equal(after, np.multiply(factor, before) if field.name in SIGNED else before), field.name


def test_lights_and_wishes_change_sides():
    every = np.arange(16, dtype=np.uint8)
    states = ActorStates(step=0, **{name: every.astype(kind) for name, kind in ACTOR_STATE_DTYPES.items()})
    lights = [Lights(int(code)) for code in mirror_image(states).lights]
    for code, image in enumerate(lights):
        assert bool(image & Lights.INDICATOR_LEFT) is bool(code & Lights.INDICATOR_RIGHT)
        assert bool(image & Lights.INDICATOR_RIGHT) is bool(code & Lights.INDICATOR_LEFT)
        assert image & (Lights.BRAKE | Lights.BEACON) == code & (Lights.BRAKE | Lights.BEACON)
    assert int(TrafficFlags.WANTS_LEFT) == int(Lights.INDICATOR_LEFT)
    assert int(TrafficFlags.WANTS_RIGHT) == int(Lights.INDICATOR_RIGHT)


def test_events_and_advice():
    image = mirror_image(EVENT)
    assert (image.x_m, image.y_m) == (2.0, -7.0)
    assert image.detail == {"side": 1, "offset_m": 1.5, "partial": 0, "reason": "x"}
    assert mirror_image(ADVICE).lane_change_intent == -1
    assert mirror_image(mirror_image(EVENT)) == EVENT


def test_yaws_stay_in_their_range():
    yaws = np.array([np.pi, -3.0, 0.5, 0.0])
    states = ActorStates(step=0, **{name: yaws.astype(kind) for name, kind in ACTOR_STATE_DTYPES.items()})
    assert mirror_image(states).yaw_rad.tolist() == [np.pi, 3.0, -0.5, 0.0]


def test_the_image_of_an_answer_from_the_seat_turns_the_other_way():
    control = AvControl(4, 0.5, 0.0, 0.25, int(Lights.INDICATOR_LEFT))
    image = mirror_image(control)
    assert image == AvControl(4, 0.5, 0.0, -0.25, int(Lights.INDICATOR_RIGHT))
    assert type(image.lights) is int
    assert mirror_image(image) == control
