"""Creates, encodes and decodes messages without rclpy; all conversions use it.

Messages are encoded and decoded as CDR with errors that name the topic, and their stamps are read without decoding.
Any program may have sent a message, so its texts and numbers are checked, with one error for all that does not fit.
"""

import json
import os
import struct
import sys
from collections.abc import Callable, Iterable
from dataclasses import fields, replace
from enum import Enum
from functools import cache, wraps
from pathlib import Path
from typing import Any, Final, TypeVar

import numpy as np
import numpy.typing as npt
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from siren_ros.base.numerics.units import NS_PER_S, STEP_NS, exact_s, step_of_time_ns, time_ns_of_step
from siren_ros.base.params import plain_files
from siren_ros.base.params.folders import params_dir
from siren_ros.data.interfaces.topics import Topic
from siren_ros.errors import EpisodeError, InputError

OWN_PACKAGE: Final = "siren_msgs"
DEFINED_PACKAGES: Final = (OWN_PACKAGE, "vision_msgs")
"""Packages whose types are missing from rosbags' Jazzy store."""


def message_folder(package: str) -> Path:
    """Folder of a package's ``.msg`` files, from an installed package or from this library; otherwise InputError."""
    prefixes = [Path(prefix) for prefix in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep) if prefix]
    folders = [prefix / "share" / package / "msg" for prefix in (*prefixes, Path(sys.prefix))]
    for folder in (*folders, params_dir().parent / "interfaces" / package / "msg"):
        if folder.is_dir():
            return folder
    raise InputError("package", package, "an installed interface package (share/PACKAGE/msg in AMENT_PREFIX_PATH)")


def load_typestore(message_folders: dict[str, Path]) -> Typestore:
    """ROS 2 Jazzy's types plus those of further packages, each given with its folder of ``.msg`` files."""
    store = get_typestore(Stores.ROS2_JAZZY)
    for package, folder in sorted(message_folders.items()):
        for path in sorted(folder.glob("*.msg")):
            store.register(get_types_from_msg(path.read_text(encoding="utf-8"), f"{package}/msg/{path.stem}"))
    store.get_msgdef = cache(store.get_msgdef)  # type: ignore[method-assign]  # rosbags asks for it at every nested message
    return store


@cache
def typestore() -> Typestore:
    """All message types of the node graph."""
    return load_typestore({package: message_folder(package) for package in DEFINED_PACKAGES})


@cache
def _message_class(type_name: str) -> type[Any]:
    return typestore().types[type_name]


def make_message(type_name: str, **content: Any) -> Any:
    """Create a message of a type such as ``siren_msgs/msg/Event``; all its fields must be given."""
    return _message_class(type_name)(**content)


def sequence(values: npt.NDArray[np.generic]) -> npt.NDArray[np.generic]:
    """Convert a one-dimensional array to a primitive sequence field."""
    return np.ascontiguousarray(values)


def stamp(time_ns: int) -> Any:
    """``builtin_interfaces/Time`` of a simulated time."""
    sec, nanosec = divmod(time_ns, NS_PER_S)
    return make_message("builtin_interfaces/msg/Time", sec=sec, nanosec=nanosec)


def time_ns_of(message: Any) -> int:
    """Simulated time of a ``builtin_interfaces/Time``; InputError if its nanoseconds reach a second."""
    sec, nanosec = int(message.sec), int(message.nanosec)
    if nanosec >= NS_PER_S:
        raise InputError("stamp", f"{sec} s and {nanosec} ns", "fewer nanoseconds than a second has")
    return sec * NS_PER_S + nanosec


def check_stamp(message: Any, step: int) -> None:
    """Check that the ``builtin_interfaces/Time`` of another program is the time of a step; otherwise EpisodeError."""
    time_ns = time_ns_of(message)
    if time_ns != time_ns_of_step(step):
        raise EpisodeError(f"the stamp {exact_s(time_ns)} s is not the time of step {step}")


def header(step: int, frame_id: str) -> Any:
    """``std_msgs/Header`` at a step."""
    return make_message("std_msgs/msg/Header", stamp=stamp(time_ns_of_step(step)), frame_id=frame_id)


def step_of(message: Any) -> int:
    """Step of a message with a header; InputError if its stamp is not the time of a step."""
    return step_of_time_ns(time_ns_of(message.header.stamp))


def at_step(step: int) -> dict[str, Any]:
    """The fields ``stamp`` and ``step`` of a message."""
    return {"stamp": stamp(time_ns_of_step(step)), "step": step}


def as_arrays(message: Any, dtypes: dict[str, type[np.generic]]) -> dict[str, Any]:
    """Copy fields of a message into read-only arrays of the given element types."""
    arrays = {name: np.array(getattr(message, name), dtype=dtype) for name, dtype in dtypes.items()}
    for array in arrays.values():
        array.setflags(write=False)
    return arrays


def as_sequences(source: object, names: Iterable[str]) -> dict[str, Any]:
    """Convert array attributes of a dataclass to primitive sequence fields."""
    return {name: sequence(getattr(source, name)) for name in names}


Content = TypeVar("Content")


def plain_fields(value: Any, *others: str) -> dict[str, Any]:
    """Numbers, texts and codes of a dataclass as message fields of the same names, except ``others``."""
    chosen: dict[str, tuple[Any, Any]] = {
        item.name: (item.type, getattr(value, item.name)) for item in fields(value) if item.name not in others
    }
    return {name: field.value if isinstance(field, Enum) else kind(field) for name, (kind, field) in chosen.items()}


def plain_message(value: Any) -> Any:
    """Convert a dataclass that has only plain fields to the ``siren_msgs`` message of the same name."""
    return make_message(f"{OWN_PACKAGE}/msg/{type(value).__name__}", **plain_fields(value))


def from_plain_fields(kind: type[Content], message: Any, **others: Any) -> Content:
    """Make a dataclass from message fields of the same names; ``others`` gives the remaining values."""
    items: Any = fields(kind)  # type: ignore[arg-type] # a dataclass
    values = {item.name: item.type(getattr(message, item.name)) for item in items if item.name not in others}
    return kind(**values, **others)


Read = TypeVar("Read")


def checks_content(read: Callable[[Any], Read]) -> Callable[[Any], Read]:
    """Decorate a reading function: errors in a message's content (an unknown code, bad JSON) become InputError."""

    @wraps(read)
    def checked(message: Any) -> Read:
        try:
            return read(message)
        except (ValueError, TypeError, KeyError, OverflowError, RecursionError) as error:
            name = str(getattr(message, "__msgtype__", type(message).__name__))
            raise InputError(name, str(error), "a message with the content that its definition names") from error

    return checked


def json_object(text: str) -> dict[str, Any]:
    """Parse the JSON object in a text field; ValueError or TypeError if it is not JSON or not an object."""
    value = plain_files.load_json(text)
    if not isinstance(value, dict):
        raise TypeError(f"no JSON object but {type(value).__name__}")
    return value


def json_text(value: object) -> str:
    """JSON of a value; equal values give equal bytes."""
    return json.dumps(value, sort_keys=True, separators=(",", ":"), ensure_ascii=False)


_ENCAPSULATION_BYTES: Final = 4
_WORD_BYTES: Final = 4
_SEQUENCE_OF_STAMPED: Final = frozenset({"tf2_msgs/msg/TFMessage", "visualization_msgs/msg/MarkerArray"})
"""Types that begin with a sequence of elements with headers; all other types begin with their own stamp."""
_BYTES_AFTER_DATA: Final = {
    "sensor_msgs/msg/PointCloud2": 1,
    "sensor_msgs/msg/Image": 0,
    "sensor_msgs/msg/CompressedImage": 0,
}
"""Types whose field ``data`` holds megabytes, with the number of bytes that follow this field."""
_LENGTH: Final = struct.Struct("<I")


def encode_cdr(store: Typestore, topic: Topic, message: Any) -> bytes:
    """Encode a message as CDR, padded to a multiple of four bytes.

    DDS pads a payload between processes but not within a process. A payload of whole words is the same bytes
    everywhere. Points and pictures are copied once. What ``cdr`` has written already stays as it is.
    """
    if isinstance(message, bytes):
        return message
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
    """Decode a CDR; arrays of the message share its bytes. Invalid bytes raise EpisodeError with the topic."""
    try:
        return store.deserialize_cdr(cdr, topic.type_name)
    except Exception as error:  # rosbags' reader raises many kinds of errors on foreign bytes, among them asserts
        what = f"{type(error).__name__}: {error}" if str(error) else type(error).__name__
        text = f"{topic.name}: a message of {len(cdr)} bytes that is no {topic.type_name} ({what})"
        raise EpisodeError(text) from error


def step_of_cdr(topic: Topic, cdr: bytes) -> int:
    """Step of an encoded message of a periodic topic; EpisodeError if it is too short or its stamp is not a step's.

    All message types of the node graph begin with a stamp, a header, or a sequence of headers.
    """
    offset = _ENCAPSULATION_BYTES + (4 if topic.type_name in _SEQUENCE_OF_STAMPED else 0)
    if len(cdr) < offset + 8:
        raise EpisodeError(f"{topic.name}: a message of {len(cdr)} bytes has no stamp")
    sec, nanosec = struct.unpack_from("<iI" if cdr[1] else ">iI", cdr, offset)
    step, rest = divmod(sec * NS_PER_S + nanosec, STEP_NS)
    if rest or step < 0 or nanosec >= NS_PER_S:
        raise EpisodeError(f"{topic.name}: the stamp {sec} s and {nanosec} ns is not the time of a step")
    return int(step)
