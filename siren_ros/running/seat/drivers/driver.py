"""What a driver in the seat is."""

from typing import Protocol, TypeVar

from siren_ros.running.seat.sight import Sight
from siren_ros.simulation.world.commands import AvControl

State = TypeVar("State")


class Driver(Protocol[State]):
    """Somebody who drives; the decision is pure."""

    @property
    def start(self) -> State:
        """The state before the first step."""

    def step(self, state: State, sight: Sight) -> tuple[State, AvControl]:
        """The answer to a step, and the state after it."""
