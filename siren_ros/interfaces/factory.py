"""Where message objects come from: rclpy's classes in a live node, rosbags' types offline.

Both build a message from keyword arguments and read it by attribute; they differ in how a primitive
sequence is handed over. Conversions are written once against this protocol.
"""

from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt


class MessageFactory(Protocol):
    """Makes messages of one middleware's kind."""

    def make(self, type_name: str, **fields: Any) -> Any:
        """A message of a type such as ``siren_msgs/msg/Event`` with all its fields set."""

    def sequence(self, values: npt.NDArray[np.generic]) -> Any:
        """A primitive sequence field from a one-dimensional array."""


def stamp(factory: MessageFactory, time_ns: int) -> Any:
    """``builtin_interfaces/Time`` of a simulated time."""
    sec, nanosec = divmod(time_ns, 1_000_000_000)
    return factory.make("builtin_interfaces/msg/Time", sec=sec, nanosec=nanosec)


def time_ns_of(message: Any) -> int:
    """Simulated time of a ``builtin_interfaces/Time``."""
    return int(message.sec) * 1_000_000_000 + int(message.nanosec)


def header(factory: MessageFactory, time_ns: int, frame_id: str) -> Any:
    """``std_msgs/Header``."""
    return factory.make("std_msgs/msg/Header", stamp=stamp(factory, time_ns), frame_id=frame_id)


def as_arrays(message: Any, dtypes: dict[str, type[np.generic]]) -> dict[str, Any]:
    """Fields of a message as read-only arrays of the given element types, copied out of the message's memory."""
    arrays = {name: np.array(getattr(message, name), dtype=dtype) for name, dtype in dtypes.items()}
    for array in arrays.values():
        array.setflags(write=False)
    return arrays


def as_sequences(factory: MessageFactory, source: object, names: Sequence[str]) -> dict[str, Any]:
    """Array attributes of a dataclass as primitive sequence fields."""
    return {name: factory.sequence(getattr(source, name)) for name in names}
