"""How far a vehicle may go into the hand-made crossing.

The middle of the way east lies 14.75 m beyond the line, and it is 3.5 m wide.
"""

import math

import pytest
from hand_made_record import EAST, STRAIGHT, STRAIGHT_LEFT, crossing

from siren_ros.simulation.conflicts.junction_room import JunctionRoom

NETWORK = crossing()
ROOM = JunctionRoom(NETWORK)
EDGE_M = 14.75 - 0.5 * 3.5 - 1.0
"""A metre before the way of those who go east."""


def lights(east):
    state = ["r"] * 7
    state[EAST] = east
    return {"J": "".join(state)}


@pytest.mark.parametrize("movement", [STRAIGHT, STRAIGHT_LEFT])
@pytest.mark.parametrize("east", "Ggy")
def test_the_room_ends_a_metre_before_the_way_of_those_who_may_come(movement, east):
    room_m = ROOM.beyond_line_m(NETWORK.connections[movement], lights(east), frozenset())
    assert EDGE_M < room_m <= EDGE_M + 0.5, "the ways are looked at each half a metre"


def test_nobody_comes_where_all_others_have_red_and_nobody_is_on_the_junction():
    assert ROOM.beyond_line_m(NETWORK.connections[STRAIGHT], lights("r"), frozenset()) == math.inf
    inside = frozenset(NETWORK.connections[EAST].via)
    assert EDGE_M < ROOM.beyond_line_m(NETWORK.connections[STRAIGHT], lights("r"), inside) <= EDGE_M + 0.5


def test_the_same_approach_and_ways_that_do_not_meet_leave_room():
    own = frozenset(NETWORK.connections[STRAIGHT_LEFT].via)
    assert ROOM.beyond_line_m(NETWORK.connections[STRAIGHT], lights("r"), own) == math.inf
    beside = {"J": "rrrrrGG"}
    assert ROOM.beyond_line_m(NETWORK.connections[STRAIGHT], beside, frozenset()) == math.inf
