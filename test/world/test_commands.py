"""What the AV's controller may ask for, and the command that becomes of it."""

import numpy as np
import pytest

from siren_ros.errors import EpisodeError
from siren_ros.world.actors import Lights, Mode, Owner
from siren_ros.world.commands import AV_SOURCE, COMMAND_DTYPES, AvControl, VehicleCommands, av_commands


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
        ({"lights": int(Lights.BEACON | Lights.INDICATOR_LEFT)}, "lights 10"),
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


def test_columns_have_the_types_of_the_message():
    empty = VehicleCommands.empty(4, "x")
    assert (empty.step, empty.source, len(empty)) == (4, "x", 0)
    types = {name: getattr(empty, name).dtype for name in COMMAND_DTYPES}
    assert types.pop("actor_id") == np.uint32
    assert {types.pop(name) for name in ("owner", "hand_brake", "mode", "lights")} == {np.dtype(np.uint8)}
    assert set(types.values()) == {np.dtype(np.float64)}
