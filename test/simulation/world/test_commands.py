"""What the AV's controller may ask for, and the command that becomes of it."""

import pytest

from siren_ros.errors import EpisodeError
from siren_ros.simulation.world.actors import Event, EventKind, Lights, Mode, Owner
from siren_ros.simulation.world.commands import (
    AV_SOURCE,
    COMMAND_DTYPES,
    AvControl,
    VehicleCommands,
    av_commands,
    controls_in,
    with_seats,
)


@pytest.mark.parametrize("lights", [0, 2, 4, 6])
@pytest.mark.parametrize(("throttle", "brake"), [(0.0, 0.0), (0.5, 0.0), (1.0, 0.0), (0.0, 0.5), (0.0, 1.0)])
def test_pedals_from_0_to_1_and_both_indicators_can_be_asked_for(lights, throttle, brake):
    control = AvControl(3, throttle=throttle, brake=brake, steer_rad=-1.2, lights=lights)
    control.check()
    command = av_commands(control, 4, 5)
    assert (command.throttle[0], command.brake[0], command.lights[0]) == (throttle, brake, lights)


@pytest.mark.parametrize(
    ("asked", "named"),
    [
        *[({"throttle": -0.01}, "throttle -0.01 of step 3"), ({"throttle": 1.01}, "throttle 1.01")],
        *[({"throttle": float("nan")}, "throttle nan of step 3"), ({"throttle": 1.5}, "throttle 1.5 of step 3")],
        *[({"brake": 1.01}, "brake 1.01"), ({"brake": float("nan")}, "brake nan"), ({"brake": -0.1}, "brake -0.1")],
        ({"throttle": 1.0, "brake": 1.0}, "throttle 1.0 and brake 1.0 of step 3"),
        ({"throttle": 0.1, "brake": 0.1}, "one of the two pedals"),
        *[({"steer_rad": float("inf")}, "steer_rad inf"), ({"steer_rad": float("nan")}, "steer_rad nan")],
        *[({"steer_rad": 1e300}, r"steer_rad 1e\+300"), ({"steer_rad": -1.571}, "steer_rad -1.571")],
        *[({"lights": int(Lights.BRAKE)}, "lights 1"), ({"lights": int(Lights.SIREN)}, "lights 16")],
        *[({"lights": int(Lights.BEACON | Lights.INDICATOR_LEFT)}, "lights 10"), ({"lights": 32}, "lights 32")],
    ],
)
def test_what_no_vehicle_can_do_is_refused_by_name(asked, named):
    with pytest.raises(EpisodeError, match=named):
        AvControl(3, **asked).check()


def test_the_answer_to_a_step_drives_the_av_to_the_next():
    command = av_commands(AvControl(8, throttle=0.25, brake=0.5, steer_rad=-0.125, lights=4), 9, 5)
    assert (command.step, command.source, command.events) == (9, AV_SOURCE, ())
    row = {name: getattr(command, name).tolist() for name in COMMAND_DTYPES}
    assert row == {
        "actor_id": [5], "owner": [Owner.ROS], "throttle": [0.25], "brake": [0.5], "steer_rad": [-0.125],
        "hand_brake": [0], "mode": [Mode.EXTERNAL], "lights": [4],
    }  # fmt: skip


EMV_LIGHTS = int(Lights.BEACON | Lights.SIREN | Lights.INDICATOR_LEFT)
ASKED = VehicleCommands.of(
    7,
    "emv_controller",
    [(1, Owner.ROS, 0.5, 0.0, 0.1, False, Mode.NOMINAL, EMV_LIGHTS), (2, Owner.SUMO, 0.0, 0.0, 0.0, False, 0, 0)],
    tuple(Event(7, EventKind.YIELD_HELD, one) for one in (1, 2)),
)


def test_who_sits_in_a_seat_takes_the_place_of_the_controller():
    control = AvControl(6, brake=0.25, steer_rad=-0.2, lights=int(Lights.INDICATOR_RIGHT))
    seated = with_seats(ASKED, {1: control, 9: AvControl(6, throttle=1.0)}, {1, 9})
    assert seated.actor_id.tolist() == [1, 2, 9]
    assert (seated.brake[0], seated.steer_rad[0], seated.mode[0]) == (0.25, -0.2, Mode.EXTERNAL)
    assert seated.lights[0] == Lights.BEACON | Lights.SIREN | Lights.INDICATOR_RIGHT  # the siren stays on
    assert [event.actor_id for event in seated.events] == [2]
    assert (seated.step, seated.source) == (7, "emv_controller")


def test_a_seat_whose_driver_another_controller_answers_for_is_left_out():
    left = with_seats(ASKED, {}, {1})
    assert left.actor_id.tolist() == [2]
    assert [event.actor_id for event in left.events] == [2]


def test_commands_tell_what_the_drivers_in_seats_asked_for():
    controls = {1: AvControl(6, throttle=0.5, lights=2), 9: AvControl(6, brake=1.0, steer_rad=0.3, lights=4)}
    assert controls_in(with_seats(ASKED, controls, set(controls))) == controls
    assert controls_in(ASKED) == {}
