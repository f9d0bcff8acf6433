"""The table of drivers by name."""

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any, Final

from siren_ros.base.params.resources import params_dir
from siren_ros.errors import InputError
from siren_ros.running.seat.drivers.driver import Driver
from siren_ros.running.seat.drivers.habits import FAULTS, HABITS, faulty
from siren_ros.running.seat.drivers.keeps_lane import LaneKeeper
from siren_ros.running.seat.drivers.lawful import LawfulDriver
from siren_ros.running.seat.drivers.learned import SHIPPED, open_driver

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
    **{f"lawful-{place}": partial(_lawful, place) for place in HABITS},
    **{f"{fault}-{place}": partial(_faulty, fault, place) for fault in FAULTS for place in HABITS},
}
"""Constructor of each driver.

``idm``, the one that ``siren train driver`` made, and for each place a lawful one and one with each fault.
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
