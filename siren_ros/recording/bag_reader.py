"""Reads an episode's bag with the message definitions in the bag."""

import struct
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from rosbags.highlevel import AnyReader
from rosbags.interfaces import Connection, ConnectionExtRosbag2, Nodetype
from rosbags.typesys.store import Typestore

from siren_ros.errors import BagError, SirenError
from siren_ros.recording.bag_guard import check_bag_files
from siren_ros.recording.bag_metadata import METADATA_FILE
from siren_ros.recording.episode_record import EpisodeRecord
from siren_ros.recording.record_builder import RECORD_TOPICS, RecordBuilder

_STAMPED_FIRST: Final = frozenset({"std_msgs/msg/Header", "builtin_interfaces/msg/Time"})
_STAMP: Final = struct.Struct("<iI")
_ENCAPSULATION_BYTES: Final = 4
_LITTLE_ENDIAN_CDR: Final = b"\x00\x01"
_typestores: Final[dict[frozenset[tuple[str, str]], Typestore]] = {}
"""By the definitions of a bag. A store compiles a reader for each type; bags of one version share their definitions."""


@contextmanager
def damage_refused(path: Path) -> Iterator[None]:
    """Turns any error of a parser on damaged or foreign content into a BagError that names the bag."""
    try:
        yield
    except SirenError:
        raise
    except Exception as error:  # rosbags and zstd raise a dozen kinds, asserts among them, on damaged content
        raise BagError(str(path), f"an undamaged episode ({type(error).__name__}: {error})") from error


@dataclass(frozen=True)
class BagMessage:
    """One message of a bag; its CDR is decoded on demand."""

    topic: str
    type_name: str
    time_ns: int
    cdr: bytes
    bag: "OpenBag"

    def read(self) -> Any:
        """Decodes the message with the bag's definition; BagError where the two do not fit."""
        with damage_refused(self.bag.path):
            return self.bag.reader.deserialize(self.cdr, self.type_name)


class OpenBag:
    """A bag that is open for reading."""

    def __init__(self, path: Path, reader: AnyReader) -> None:
        self.path = path
        self.reader = reader
        self.type_names = {connection.topic: connection.msgtype for connection in reader.connections}
        self.latched = frozenset(item.topic for item in reader.connections if _is_latched(item))
        """Topics whose publishers were transient local."""
        self._stamped = {name for name in set(self.type_names.values()) if _starts_with_stamp(reader.typestore, name)}

    @property
    def span_ns(self) -> tuple[int, int]:
        """Times of the first and the last message."""
        return self.reader.start_time, self.reader.end_time - 1

    def messages(self, topics: Collection[str] | None = None) -> Iterator[BagMessage]:
        """Messages in the order of simulated time; all topics, or those given.

        Raises:
            BagError: The bag is damaged after the last message that was returned.
        """
        wanted = [item for item in self.reader.connections if topics is None or item.topic in topics]
        if not wanted:
            return
        with damage_refused(self.path):
            for connection, time_ns, cdr in self.reader.messages(wanted):
                yield BagMessage(connection.topic, connection.msgtype, time_ns, cdr, self)

    def stamp_ns(self, message: BagMessage) -> int | None:
        """The stamp at the start of a message, without decoding the rest; None where the type has none."""
        enough = len(message.cdr) >= _ENCAPSULATION_BYTES + _STAMP.size
        if message.type_name not in self._stamped or not enough or message.cdr[:2] != _LITTLE_ENDIAN_CDR:
            return None
        sec, nanosec = _STAMP.unpack_from(message.cdr, _ENCAPSULATION_BYTES)
        return int(sec) * 1_000_000_000 + int(nanosec)


def _is_latched(connection: Connection) -> bool:
    offers = connection.ext.offered_qos_profiles if isinstance(connection.ext, ConnectionExtRosbag2) else []
    return any(offer.durability.name == "TRANSIENT_LOCAL" for offer in offers)


def _starts_with_stamp(store: Typestore, type_name: str) -> bool:
    _, fields = store.fielddefs[type_name]
    if not fields:
        return False
    kind, detail = fields[0][1]
    return kind == Nodetype.NAME and detail in _STAMPED_FIRST


@contextmanager
def open_bag(path: Path) -> Iterator[OpenBag]:
    """Opens a bag for reading.

    Raises:
        BagError: The folder is missing, is not a rosbag2 bag, or is damaged.
    """
    try:
        there = path.is_dir()
    except OSError:  # a name that is too long
        there = False
    if not there:
        raise BagError(str(path), "a folder that exists, of a recorded episode")
    if not (path / METADATA_FILE).is_file():
        allowed = f"a rosbag2 folder with {METADATA_FILE}"
        cut_off = "; this one was cut off, `siren recover` completes it" if any(path.glob("*.mcap")) else ""
        raise BagError(str(path), allowed + cut_off)
    check_bag_files(path)
    with damage_refused(path):
        reader = AnyReader([path])
        reader.open()
        definitions = frozenset((item.msgtype, item.msgdef.data) for item in reader.connections)
        reader.typestore = _typestores.setdefault(definitions, reader.typestore)
    try:
        with damage_refused(path):
            bag = OpenBag(path, reader)
        yield bag
    finally:
        reader.close()


def read_episode(path: Path) -> EpisodeRecord:
    """The record of an episode.

    Raises:
        BagError: As ``open_bag``; or the bag holds no SIREN episode, or lacks the map.
    """
    builder = RecordBuilder()
    record_topics = {topic.name: topic.type_name for topic in RECORD_TOPICS}
    with open_bag(path) as bag:
        for topic, type_name in record_topics.items():
            if bag.type_names.get(topic, type_name) != type_name:
                raise BagError(str(path), f"{topic} of type {type_name}, not {bag.type_names[topic]}")
        for message in bag.messages():
            builder.count(message.topic, message.type_name, message.time_ns, len(message.cdr), bag.stamp_ns(message))
            if message.topic in record_topics:
                decoded = message.read()
                with damage_refused(path):
                    builder.add(message.topic, decoded)
        return builder.build(str(path))
