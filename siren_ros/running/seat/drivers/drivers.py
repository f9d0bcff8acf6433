"""The drivers by name, the protocol of a driver, and the driver that ignores sirens."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Final, Protocol, TypeVar

from siren_ros.base.params.folders import params_dir
from siren_ros.errors import InputError
from siren_ros.running.seat.control import (
    indicators,
    speed_to_junction,
    speed_to_leader,
    speed_to_limit,
    speed_to_red,
    steered,
)
from siren_ros.running.seat.drivers.lawful import FAULTS, HABITS, LawfulDriver, faulty
from siren_ros.running.seat.drivers.learned import BY_RULE, SHIPPED, open_driver
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


@dataclass(frozen=True)
class LaneKeeper:
    """Follows its leader with the equilibrium of the Intelligent Driver Model (Treiber, Hennecke, Helbing 2000)."""

    @property
    def start(self) -> None:
        """Return an empty state: it remembers nothing."""
        return

    def step(self, state: None, sight: Sight) -> tuple[None, AvControl]:
        """Decide a step."""
        wanted = min(speed_to_limit(sight), speed_to_leader(sight, 0.0), speed_to_red(sight), speed_to_junction(sight))
        return state, steered(sight, wanted, 0.0, indicators(sight))


_ONNX: Final = ".onnx"


def _lawful(place: str) -> Driver[Any]:
    return LawfulDriver(HABITS[place])


def _faulty(fault: str, place: str) -> Driver[Any]:
    return LawfulDriver(faulty(HABITS[place], fault))


def _learned() -> Driver[Any]:
    return open_driver(params_dir() / SHIPPED)


DRIVERS: Final[Mapping[str, Callable[[], Driver[Any]]]] = {
    "idm": LaneKeeper,
    "learned": _learned,
    "pulls-over": lambda: BY_RULE,
    **{f"lawful-{place}": partial(_lawful, place) for place in HABITS},
    **{f"{fault}-{place}": partial(_faulty, fault, place) for fault in FAULTS for place in HABITS},
}
"""Constructor of each driver.

``idm``, the one that ``siren train driver`` made, the rule that is better, and for each place a lawful one and one
with each fault.
"""


def driver_of(name: str) -> Driver[Any]:
    """Make a driver by its name, or a learned one from the path of its file.

    Raises:
        InputError: There is no such driver, or its file cannot be used.
    """
    if name.endswith(_ONNX):
        return open_driver(Path(name))
    if name not in DRIVERS:
        raise InputError("driver", name, f"one of {', '.join(DRIVERS)}, or an ONNX file")
    return DRIVERS[name]()
