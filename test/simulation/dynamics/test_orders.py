"""Commands on the rows of the actors, and what becomes of them for who has been in contact."""

from dataclasses import replace

import numpy as np
import pytest
from dynamics.fleet_scenes import command_of, stacked, traffic_of

from siren_ros.errors import EpisodeError
from siren_ros.simulation.dynamics.orders import merge_commands, stopped_orders
from siren_ros.simulation.world.actors import Lights, Mode, Owner

ROWS = {2: (0.0, 0.0, 0.0, 5.0), 5: (20.0, 0.0, 0.0, 5.0), 9: (40.0, 0.0, 0.0, 5.0)}
LIGHTS = {2: Lights.INDICATOR_LEFT, 5: Lights.INDICATOR_RIGHT, 9: Lights.SIREN}


def test_each_command_lies_on_its_actors_row_and_the_others_are_sumos():
    command = stacked(
        command_of(3, 9, throttle=0.4, brake=0.1, steer=-0.2, mode=Mode.REJOIN, lights=Lights.BEACON),
        command_of(3, 2, throttle=0.7, brake=0.3, steer=0.1, mode=Mode.YIELD_HOLD, lights=Lights.SIREN),
    )
    command = replace(command, hand_brake=np.array([0, 1], np.uint8))
    orders = merge_commands(traffic_of(3, ROWS, lights=LIGHTS), [command])
    assert orders.owner.tolist() == [Owner.ROS, Owner.SUMO, Owner.ROS]
    assert orders.throttle.tolist() == [0.7, 0.0, 0.4]
    assert orders.brake.tolist() == [0.3, 0.0, 0.1]
    assert orders.steer_rad.tolist() == [0.1, 0.0, -0.2]
    assert orders.hand_brake.tolist() == [True, False, False]
    assert orders.mode.tolist() == [Mode.YIELD_HOLD, Mode.NOMINAL, Mode.REJOIN]
    assert orders.lights.tolist() == [Lights.SIREN, Lights.INDICATOR_RIGHT, Lights.BEACON]


def test_of_a_command_the_rows_of_actors_that_left_are_void_and_the_others_hold():
    command = stacked(command_of(3, 4, throttle=1.0), command_of(3, 5, throttle=0.5))
    orders = merge_commands(traffic_of(3, ROWS, removed=[4]), [command])
    assert orders.throttle.tolist() == [0.0, 0.5, 0.0]
    assert orders.owner.tolist() == [Owner.SUMO, Owner.ROS, Owner.SUMO]
    with pytest.raises(EpisodeError, match=r"commands actors \[4, 7\], unknown"):
        merge_commands(traffic_of(3, ROWS, removed=[4]), [stacked(command_of(3, 4), command_of(3, 7))])


@pytest.mark.parametrize("field", ["throttle", "brake", "steer"])
@pytest.mark.parametrize("value", [float("nan"), float("inf")])
def test_the_actor_whose_command_is_not_finite_is_named(field, value):
    command = stacked(command_of(3, 2), command_of(3, 5, **{field: value}))
    with pytest.raises(EpisodeError, match="commands actor 5 by values that are not finite"):
        merge_commands(traffic_of(3, ROWS), [command])


def test_of_two_controllers_of_one_actor_both_and_the_actor_are_named():
    first = stacked(command_of(3, 2, source="a"), command_of(3, 5, source="a"))
    second = stacked(command_of(3, 9, source="c"), command_of(3, 5, source="c"))
    with pytest.raises(EpisodeError, match="c and a both command actor 5 at step 3"):
        merge_commands(traffic_of(3, ROWS), [first, _empty("b"), second])


def _empty(source):
    command = command_of(3, 2, source=source)
    arrays = {name: value[:0] for name, value in vars(command).items() if isinstance(value, np.ndarray)}
    return replace(command, **arrays)


def test_who_was_in_contact_brakes_with_its_wheels_as_they_are_and_the_others_do_as_they_are_told():
    asked = {"throttle": 0.4, "brake": 0.1, "steer": 0.3, "mode": Mode.ROUTE_FOLLOW, "lights": Lights.SIREN}
    command = stacked(*(command_of(3, i, **asked) for i in ROWS))
    orders = merge_commands(traffic_of(3, ROWS), [command])._replace(hand_brake=np.ones(3, bool))
    present = np.array([0.01, -0.02, 0.03])
    ids = np.array([2, 5, 9], np.uint32)
    stopped = stopped_orders(orders, ids, (5, 77), present)
    assert stopped.owner.tolist() == [Owner.ROS] * 3
    assert stopped.throttle.tolist() == [0.4, 0.0, 0.4]
    assert stopped.brake.tolist() == [0.1, 1.0, 0.1]
    assert stopped.steer_rad.tolist() == [0.3, -0.02, 0.3]
    assert stopped.hand_brake.tolist() == [True, False, True]
    assert stopped.mode.tolist() == [Mode.ROUTE_FOLLOW, Mode.STOPPED, Mode.ROUTE_FOLLOW]
    hazard = Lights.INDICATOR_LEFT | Lights.INDICATOR_RIGHT
    assert stopped.lights.tolist() == [Lights.SIREN, Lights.SIREN | hazard, Lights.SIREN]
    assert stopped_orders(orders, ids, (), present) is orders
    assert stopped_orders(orders, ids, (77,), present) is orders
    taken = stopped_orders(merge_commands(traffic_of(3, ROWS), []), ids, (9,), present)
    assert taken.owner.tolist() == [Owner.SUMO, Owner.SUMO, Owner.ROS]
