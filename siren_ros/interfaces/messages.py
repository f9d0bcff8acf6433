"""Message objects of the types that this installation defines, without rclpy: what all conversions build on."""

import os
import sys
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from siren_ros.errors import EpisodeError, InputError
from siren_ros.numerics.units import NS_PER_S, exact_s, time_ns_of_step

OWN_PACKAGE: Final = "siren_msgs"
DEFINED_PACKAGES: Final = (OWN_PACKAGE, "vision_msgs")
"""Packages whose types rosbags' Jazzy store does not hold."""


def message_folder(package: str) -> Path:
    """Folder of an installed package's ``.msg`` files.

    Raises:
        InputError: The package is not installed.
    """
    prefixes = [Path(prefix) for prefix in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep) if prefix]
    for prefix in (*prefixes, Path(sys.prefix)):
        folder = prefix / "share" / package / "msg"
        if folder.is_dir():
            return folder
    raise InputError("package", package, "an installed interface package (share/PACKAGE/msg in AMENT_PREFIX_PATH)")


def load_typestore(message_folders: dict[str, Path]) -> Typestore:
    """ROS 2 Jazzy's types plus the ``.msg`` files of further packages.

    Args:
        message_folders: Folder of ``.msg`` files by package name.
    """
    store = get_typestore(Stores.ROS2_JAZZY)
    for package, folder in sorted(message_folders.items()):
        for path in sorted(folder.glob("*.msg")):
            store.register(get_types_from_msg(path.read_text(encoding="utf-8"), f"{package}/msg/{path.stem}"))
    store.get_msgdef = cache(store.get_msgdef)  # type: ignore[method-assign]  # asked for at every nested message
    return store


@cache
def typestore() -> Typestore:
    """All message types of the node graph, as this installation defines them."""
    return load_typestore({package: message_folder(package) for package in DEFINED_PACKAGES})


@cache
def _message_class(type_name: str) -> type[Any]:
    return typestore().types[type_name]


def make_message(type_name: str, **fields: Any) -> Any:
    """A message of a type such as ``siren_msgs/msg/Event`` with all its fields set."""
    return _message_class(type_name)(**fields)


def sequence(values: npt.NDArray[np.generic]) -> npt.NDArray[np.generic]:
    """A primitive sequence field from a one-dimensional array."""
    return np.ascontiguousarray(values)


def stamp(time_ns: int) -> Any:
    """``builtin_interfaces/Time`` of a simulated time."""
    sec, nanosec = divmod(time_ns, NS_PER_S)
    return make_message("builtin_interfaces/msg/Time", sec=sec, nanosec=nanosec)


def time_ns_of(message: Any) -> int:
    """Simulated time of a ``builtin_interfaces/Time``.

    Raises:
        InputError: Its nanoseconds make a second or more; another program made it.
    """
    sec, nanosec = int(message.sec), int(message.nanosec)
    if nanosec >= NS_PER_S:
        raise InputError("stamp", f"{sec} s and {nanosec} ns", "fewer nanoseconds than a second has")
    return sec * NS_PER_S + nanosec


def check_stamp(message: Any, step: int) -> None:
    """Refuse a ``builtin_interfaces/Time`` that is not the time of a step.

    Raises:
        EpisodeError: Names both; another program may have made the message.
    """
    time_ns = time_ns_of(message)
    if time_ns != time_ns_of_step(step):
        raise EpisodeError(f"the stamp {exact_s(time_ns)} s is not the time of step {step}")


def header(time_ns: int, frame_id: str) -> Any:
    """``std_msgs/Header``."""
    return make_message("std_msgs/msg/Header", stamp=stamp(time_ns), frame_id=frame_id)


def as_arrays(message: Any, dtypes: dict[str, type[np.generic]]) -> dict[str, Any]:
    """Fields of a message as read-only arrays of the given element types, copied out of the message's memory."""
    arrays = {name: np.array(getattr(message, name), dtype=dtype) for name, dtype in dtypes.items()}
    for array in arrays.values():
        array.setflags(write=False)
    return arrays


def as_sequences(source: object, names: Sequence[str]) -> dict[str, Any]:
    """Array attributes of a dataclass as primitive sequence fields."""
    return {name: sequence(getattr(source, name)) for name in names}
