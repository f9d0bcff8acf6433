"""The protocol of a driver."""

from typing import Protocol, TypeVar

from siren_ros.running.seat.sight import Sight
from siren_ros.simulation.world.commands import AvControl

State = TypeVar("State")


class Driver(Protocol[State]):
    """A driver; its decision is a pure function."""

    @property
    def start(self) -> State:
        """State before the first step."""

    def step(self, state: State, sight: Sight) -> tuple[State, AvControl]:
        """Decide a step: the new state, and the control of the vehicle."""
