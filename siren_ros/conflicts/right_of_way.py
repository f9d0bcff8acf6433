"""Who has the right of way: the rank of a movement across a junction."""

from collections.abc import Mapping
from enum import IntEnum
from typing import Final

from siren_ros.roads.road_network import Connection


class Rank(IntEnum):
    """The higher one has the right of way; equals go in the order in which they arrive."""

    RED = 0
    """Who can stop will not come."""
    STOP_SIGN = 1
    CLEARING = 2
    """Yellow: who cannot stop goes on."""
    GIVES_WAY = 3
    """Green that gives way to oncoming traffic, or a minor road."""
    PRIORITY = 4
    """Green without conditions, a major road, or no junction at all."""


_OF_SIGNAL: Final[Mapping[str, Rank]] = {
    "G": Rank.PRIORITY,
    "g": Rank.GIVES_WAY,
    "s": Rank.GIVES_WAY,
    "o": Rank.GIVES_WAY,
    "O": Rank.PRIORITY,
    "y": Rank.CLEARING,
    "Y": Rank.CLEARING,
    "u": Rank.RED,
    "r": Rank.RED,
}
"""SUMO's signal states (https://sumo.dlr.de/docs/Simulation/Traffic_Lights.html, Signal state definitions)."""


def rank_of(connection: Connection, signals: Mapping[str, str]) -> Rank:
    """The rank of a movement at present.

    Args:
        connection: The movement.
        signals: State of each signal: one character per controlled link.
    """
    state = signals.get(connection.signal_id or "", "")
    if 0 <= connection.signal_link < len(state):
        return _OF_SIGNAL.get(state[connection.signal_link], Rank.RED)
    if connection.must_stop:
        return Rank.STOP_SIGN
    return Rank.GIVES_WAY if connection.gives_way else Rank.PRIORITY


def rank_inside(rank: Rank) -> Rank:
    """The rank of who is on the junction already: it is left clear for them, unless they give way on it."""
    return rank if rank is Rank.GIVES_WAY else Rank.PRIORITY
