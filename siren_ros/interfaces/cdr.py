"""Serialised messages: encoded, decoded with errors that name the topic, and their stamps read without decoding."""

import struct
from dataclasses import replace
from typing import Any, Final

from rosbags.typesys.store import Typestore

from siren_ros.errors import EpisodeError
from siren_ros.interfaces.topics import Topic
from siren_ros.numerics.units import NS_PER_S, STEP_NS

_ENCAPSULATION_BYTES: Final = 4
_WORD_BYTES: Final = 4
_SEQUENCE_OF_STAMPED: Final = frozenset({"tf2_msgs/msg/TFMessage", "visualization_msgs/msg/MarkerArray"})
"""Types that begin with a sequence whose elements begin with a header; the others begin with their stamp."""
_BYTES_AFTER_DATA: Final = {
    "sensor_msgs/msg/PointCloud2": 1,
    "sensor_msgs/msg/Image": 0,
    "sensor_msgs/msg/CompressedImage": 0,
}
"""Types whose megabytes lie in ``data``, a sequence of bytes: how many bytes follow it."""
_LENGTH: Final = struct.Struct("<I")


def encode_cdr(store: Typestore, topic: Topic, message: Any) -> bytes:
    """CDR of a message, padded to whole words.

    DDS pads a payload between processes but not within a process. A payload of whole words is the same bytes
    everywhere. Points and pictures are copied once.
    """
    after = _BYTES_AFTER_DATA.get(topic.type_name)
    if after is None:
        return _filled(store.serialize_cdr(message, topic.type_name, little_endian=True))
    data = message.data
    shell = store.serialize_cdr(replace(message, data=data[:0]), topic.type_name, little_endian=True)
    head, tail = shell[: len(shell) - after - _LENGTH.size], shell[len(shell) - after :]
    return _filled(head, _LENGTH.pack(len(data)), memoryview(data), tail)


def _filled(*parts: bytes | memoryview) -> bytes:
    return b"".join((*parts, bytes(-sum(map(len, parts)) % _WORD_BYTES)))


def decode_cdr(store: Typestore, topic: Topic, cdr: bytes) -> Any:
    """The message in a CDR; its arrays are views of the bytes.

    Raises:
        EpisodeError: The bytes are no message of the topic's type; names the topic.
    """
    try:
        return store.deserialize_cdr(cdr, topic.type_name)
    except Exception as error:  # rosbags' reader raises a dozen kinds, asserts among them, on foreign bytes
        what = f"{type(error).__name__}: {error}" if str(error) else type(error).__name__
        text = f"{topic.name}: a message of {len(cdr)} bytes that is no {topic.type_name} ({what})"
        raise EpisodeError(text) from error


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
    step, rest = divmod(sec * NS_PER_S + nanosec, STEP_NS)
    if rest or step < 0 or nanosec >= NS_PER_S:
        raise EpisodeError(f"{topic.name}: the stamp {sec} s and {nanosec} ns is not the time of a step")
    return int(step)
