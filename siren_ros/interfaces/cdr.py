"""The stamp of a message, read from its serialised form without decoding it."""

import struct
from typing import Final

from siren_ros.interfaces.topics import Topic
from siren_ros.world.errors import EpisodeError
from siren_ros.world.units import STEP_NS

_ENCAPSULATION_BYTES: Final = 4
_SEQUENCE_OF_STAMPED: Final = frozenset({"tf2_msgs/msg/TFMessage", "visualization_msgs/msg/MarkerArray"})
"""Types that begin with a sequence whose elements begin with a header; the others begin with their stamp."""


def step_of_cdr(topic: Topic, cdr: bytes) -> int:
    """The step that a message of a periodic topic belongs to.

    All message types of the node graph begin with a stamp, a header, or a sequence of headers.

    Raises:
        EpisodeError: Too short, or a stamp that is no step.
    """
    offset = _ENCAPSULATION_BYTES + (4 if topic.type_name in _SEQUENCE_OF_STAMPED else 0)
    if len(cdr) < offset + 8:
        raise EpisodeError(f"{topic.name}: a message of {len(cdr)} bytes has no stamp")
    sec, nanosec = struct.unpack_from("<iI" if cdr[1] else ">iI", cdr, offset)
    step, rest = divmod(sec * 1_000_000_000 + nanosec, STEP_NS)
    if rest or step < 0:
        raise EpisodeError(f"{topic.name}: the stamp {sec}.{nanosec:09d} s is not the time of a step")
    return int(step)
