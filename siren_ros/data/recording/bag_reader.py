"""Reads bags with the message definitions that they contain: messages in the order of time, and the record.

A bag's files are checked before they are read, because a bag may come from an untrusted source. Refused are files
outside the folder, compressed files and databases, metadata with aliases, and chunks that claim or unpack to more
memory than a recorder writes.
"""

import struct
import zlib
from collections.abc import Collection, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, BinaryIO, Final

from mcap.opcode import Opcode
from mcap.reader import SeekingReader
from mcap.summary import Summary
from rosbags.highlevel import AnyReader
from rosbags.interfaces import Connection, ConnectionExtRosbag2, Nodetype
from rosbags.rosbag2 import Reader
from rosbags.typesys.store import Typestore

from siren_ros.base.numerics.units import STEP_NS
from siren_ros.data.recording.bag_folder import METADATA_FILE, read_metadata
from siren_ros.data.recording.episode_record import RECORD_TOPICS, EpisodeRecord, RecordBuilder
from siren_ros.data.recording.mcap_files import MAGIC, DamageError, read_attachment, read_chunk, read_places, unpack
from siren_ros.errors import BagError, SirenError

MAX_SUMMARY_BYTES: Final = 100_000_000
"""Largest summary that is read; the index of a million messages has 30 MB."""
_FOOTER: Final = struct.Struct("<BQQQI8s")
"""Footer record: code, length, start of the summary, start of the offsets, checksum, magic bytes of the file's end."""
_FOOTER_FIELDS_BYTES: Final = 20
_AFTER_CRC_BYTES: Final = 12
_STAMPED_FIRST: Final = frozenset({"std_msgs/msg/Header", "builtin_interfaces/msg/Time"})
_STAMP: Final = struct.Struct("<iI")
_ENCAPSULATION_BYTES: Final = 4
_LITTLE_ENDIAN_CDR: Final = b"\x00\x01"
_typestores: Final[dict[frozenset[tuple[str, str, str]], Typestore]] = {}
"""Type stores by the definitions of a bag. To make one takes as long as to read a short bag, and bags of one version
have the same definitions."""
_NO_END: Final = "the file has no end; `siren recover` completes a bag that was cut off"
MAX_BURST_NS: Final = 4 * STEP_NS
"""Largest simulated time that is published at once, because a subscriber keeps 8 messages of a topic."""
NS_PER_S: Final = 1_000_000_000


def storage_files(bag: Path) -> list[Path]:
    """The MCAP files in a bag's folder, in the order of their names."""
    return sorted(file for file in bag.glob("*.mcap") if file.is_file())


def check_bag_files(bag: Path, content: bool = False) -> None:
    """Check a bag's files; BagError says what is damaged, misplaced or too large, and where.

    With ``content`` it also unpacks each chunk, compares its checksum and those of attachments, and reads the summary.
    """
    information = read_metadata(bag)
    names = information.get("relative_file_paths")
    if information.get("compression_mode") or information.get("storage_identifier") != "mcap":
        raise BagError(str(bag), "a bag in MCAP storage, its file not compressed as a whole")
    if not isinstance(names, list) or not names or not all(isinstance(name, str) for name in names):
        raise BagError(str(bag), f"a bag whose {METADATA_FILE} names its files")
    for name in names:
        file = bag / name
        if Path(name).name != name or file.suffix != ".mcap" or not file.is_file():
            raise BagError(str(bag), f"a bag whose files are .mcap files in its folder, unlike {name!r}")
        try:
            _check_storage(file, content)
        except DamageError as error:
            raise BagError(str(bag), f"an undamaged episode ({name}: {error})") from error
        except OSError as error:
            raise BagError(str(bag), f"a bag that can be read ({error.strerror or error})") from error


def _check_storage(file: Path, content: bool) -> None:
    size = file.stat().st_size
    with file.open("rb") as stream:
        for place in read_places(stream):
            if place.opcode == Opcode.CHUNK:
                chunk = read_chunk(stream, place)
                if content:
                    unpack(chunk)
            elif content and place.opcode == Opcode.ATTACHMENT:
                read_attachment(stream, place)
        _check_end(stream, size)
        if content:
            read_summary(stream, size)


def read_summary(stream: BinaryIO, size: int) -> Summary:
    """Read the summary of a file of ``size`` bytes: definitions, statistics and the index of chunks.

    Raises DamageError: the file has no end, or its summary is damaged.
    """
    _check_end(stream, size)
    try:
        stream.seek(0)
        summary = SeekingReader(stream, validate_crcs=True).get_summary()
    except Exception as error:  # mcap raises struct.error, McapError and others on a damaged summary
        raise DamageError(f"a broken summary ({type(error).__name__}: {error})") from error
    if summary is None:
        raise DamageError("the file has no summary")
    return summary


def _check_end(stream: BinaryIO, size: int) -> None:
    """Check the footer, where readers begin: it must lead to an undamaged summary inside the file."""
    stream.seek(max(0, size - _FOOTER.size))
    end = stream.read()
    if len(end) < _FOOTER.size:
        raise DamageError(_NO_END)
    code, length, start, _, crc, magic = _FOOTER.unpack(end)
    if code != Opcode.FOOTER or length != _FOOTER_FIELDS_BYTES or magic != MAGIC or not 0 < start < size:
        raise DamageError(_NO_END)
    if size - start > MAX_SUMMARY_BYTES:
        raise DamageError(f"a summary of {size - start} bytes; {MAX_SUMMARY_BYTES} are allowed")
    stream.seek(start)
    if crc and zlib.crc32(stream.read(size - start - _AFTER_CRC_BYTES)) != crc:
        raise DamageError("the summary does not have its checksum")


@contextmanager
def damage_refused(path: Path) -> Iterator[None]:
    """Turn any error of a parser on damaged or foreign content into a BagError that names the bag."""
    try:
        yield
    except SirenError:
        raise
    except Exception as error:  # rosbags and zstd raise many kinds of errors on damaged content, among them asserts
        raise BagError(str(path), f"an undamaged episode ({type(error).__name__}: {error})") from error


@dataclass(frozen=True)
class BagMessage:
    """One message of a bag; its CDR is decoded when needed."""

    topic: str
    type_name: str
    time_ns: int
    cdr: bytes
    bag: "OpenBag"

    def read(self) -> Any:
        """Decodes the message with the bag's definition; BagError where the two do not fit."""
        with damage_refused(self.bag.path):
            return self.bag.typestore.deserialize_cdr(self.cdr, self.type_name)


class OpenBag:
    """A bag opened for reading."""

    def __init__(self, path: Path, reader: Reader) -> None:
        self.path = path
        self.reader = reader
        self.typestore = _typestore_of(path, reader)
        self.type_names = {connection.topic: connection.msgtype for connection in reader.connections}
        self.latched = frozenset(item.topic for item in reader.connections if _is_latched(item))
        """Topics whose publishers were transient local."""
        self._stamped = {name for name in set(self.type_names.values()) if _starts_with_stamp(self.typestore, name)}

    @property
    def span_ns(self) -> tuple[int, int]:
        """Times of the first and the last message."""
        return self.reader.start_time, self.reader.end_time - 1

    def messages(self, topics: Collection[str] | None = None) -> Iterator[BagMessage]:
        """Messages in the order of simulated time, of all topics or of the given ones.

        Raises BagError: the bag is damaged after the last message that was returned.
        """
        connections = [item for item in self.reader.connections if topics is None or item.topic in topics]
        if not connections:
            return
        with damage_refused(self.path):
            for connection, time_ns, cdr in self.reader.messages(connections):
                yield BagMessage(connection.topic, connection.msgtype, time_ns, cdr, self)

    def stamp_ns(self, message: BagMessage) -> int | None:
        """Read the stamp at the start of a message without decoding the rest; None if the type has none."""
        enough = len(message.cdr) >= _ENCAPSULATION_BYTES + _STAMP.size
        if message.type_name not in self._stamped or not enough or message.cdr[:2] != _LITTLE_ENDIAN_CDR:
            return None
        sec, nanosec = _STAMP.unpack_from(message.cdr, _ENCAPSULATION_BYTES)
        return int(sec) * 1_000_000_000 + int(nanosec)

    def record(self, *, counted: bool = False, unread: Collection[str] = ()) -> EpisodeRecord:
        """Read the record of the episode; all states are then in memory.

        With ``counted`` also the counts of the messages of all topics, which reads all of them. What the topics in
        ``unread`` tell is missing from the record. Raises BagError: the
        bag is damaged, holds no SIREN episode, or lacks the map.
        """
        builder = RecordBuilder()
        types = {topic.name: topic.type_name for topic in RECORD_TOPICS if topic.name not in unread}
        for topic, type_name in types.items():
            if self.type_names.get(topic, type_name) != type_name:
                raise BagError(str(self.path), f"{topic} of type {type_name}, not {self.type_names[topic]}")
        for message in self.messages(None if counted else types):
            if counted:
                stamp_ns, size_bytes = self.stamp_ns(message), len(message.cdr)
                builder.count(message.topic, message.type_name, message.time_ns, size_bytes, stamp_ns)
            if message.topic in types:
                decoded = message.read()
                with damage_refused(self.path):
                    builder.add(message.topic, decoded)
        return builder.build(str(self.path))


def _typestore_of(path: Path, reader: Reader) -> Typestore:
    """Type store for a bag; bags with the same definitions share one."""
    definitions = frozenset((item.msgtype, item.msgdef.data, item.digest) for item in reader.connections)
    if definitions not in _typestores:
        with AnyReader([path]) as parser:
            _typestores[definitions] = parser.typestore
    return _typestores[definitions]


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
    """Open a bag for reading. Raises BagError if the folder is missing, not a rosbag2 bag, or damaged."""
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
        reader = Reader(path)
        reader.open()
    try:
        with damage_refused(path):
            bag = OpenBag(path, reader)
        yield bag
    finally:
        reader.close()


def read_episode(path: Path) -> EpisodeRecord:
    """Read the record of an episode, with the number of its messages.

    Raises BagError as ``open_bag`` and ``OpenBag.record``.
    """
    with open_bag(path) as bag:
        return bag.record(counted=True)


def bags_among(paths: Iterable[Path]) -> tuple[Path, ...]:
    """Find the bags among some folders: the folders themselves, or those at any depth below, sorted by path.

    Hidden folders are left out: there bags are under way. A folder without any bag stays as it is, so that reading it
    says what is wrong.
    """
    all_bags: list[Path] = []
    for path in paths:
        inside = set() if storage_files(path) else {file.parent for file in path.rglob("*.mcap")}
        bags = sorted(bag for bag in inside if not any(part[0] == "." for part in bag.relative_to(path).parts))
        all_bags += bags or [path]
    return tuple(all_bags)


@dataclass(frozen=True)
class Playhead:
    """A position in simulated time that moves with the wall clock while it is not paused."""

    position_ns: int
    """Simulated time at ``since_s``."""
    since_s: float
    """Wall time."""
    rate: float
    """Simulated seconds per wall second."""
    paused: bool = False

    def advance(self, now_s: float) -> "Playhead":
        """Move the playhead to a later wall time. It advances by at most ``MAX_BURST_NS``, even after a long delay."""
        if self.paused:
            return replace(self, since_s=now_s)
        moved_ns = round((now_s - self.since_s) * self.rate * NS_PER_S)
        return replace(self, position_ns=self.position_ns + min(moved_ns, MAX_BURST_NS), since_s=now_s)

    def held_at(self, time_ns: int) -> "Playhead":
        """The playhead, held at the time of a message that cannot be published yet."""
        return replace(self, position_ns=min(self.position_ns, time_ns))

    def pause(self, now_s: float, paused: bool) -> "Playhead":
        """The playhead paused at its present position, or resumed from there."""
        return replace(self.advance(now_s), paused=paused)


def messages_from(bag: OpenBag, start_ns: int) -> Iterator[BagMessage]:
    """Messages for a subscriber that joins at a time: earlier latched ones, then all from that time on.

    Raises BagError: the bag is damaged after the last message that was returned.
    """
    earlier: dict[str, BagMessage] = {}
    began = False
    for message in bag.messages():
        if message.time_ns < start_ns:
            if message.topic in bag.latched:
                earlier[message.topic] = message
            continue
        if not began:
            began = True
            yield from earlier.values()
        yield message
    if not began:
        yield from earlier.values()
