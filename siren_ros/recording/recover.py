"""Completes a bag whose writer was killed or whose storage file is damaged: all whole chunks, with a new summary."""

import math
from collections import Counter
from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO, Final

from mcap.opcode import Opcode
from mcap.records import Channel, Schema
from mcap.summary import Summary

from siren_ros.errors import BagError, EpisodeError
from siren_ros.interfaces.topics import ACTORS, EPISODE, MAP
from siren_ros.recording.bag_folder import (
    METADATA_FILE,
    PARTIAL_SUFFIX,
    RESERVE_FILE,
    BagTopic,
    free_partial_path,
    lock,
    metadata_text,
    read_message_counts,
    working_path,
)
from siren_ros.recording.bag_reader import check_bag_files, read_summary, storage_files
from siren_ros.recording.bag_writer import END_KEY, REASON_KEY, BagOptions
from siren_ros.recording.mcap_scan import (
    DamageError,
    RecordPlace,
    count_index_entries,
    parse_content,
    read_chunk,
    read_copies,
    read_places,
    unpack,
)
from siren_ros.recording.mcap_stream import ChannelMessage, ChunkContent, McapStream, plain_bytes

_REASON: Final = "recovered after its writer was cut off"
_RECORD_HEAD_BYTES: Final = 9


@dataclass(frozen=True)
class Recovery:
    """The result of a recovery."""

    path: Path
    messages: int
    steps: int
    healthy: bool
    """The bag was complete already, and nothing was written."""
    lost_messages: int = 0
    """Messages of the damaged file that could not be saved, as far as the file gives their number."""
    lost: str = ""
    """What could not be saved, and why; empty where nothing was lost."""
    described: bool = True
    """Whether the episode's description and its map were saved; without them the bag is no episode."""
    restored: int = 0
    """Messages that were taken from their second copies, because their chunks cannot be read."""


@dataclass
class _Chunks:
    """The chunks of a damaged file."""

    places: list[RecordPlace] = field(default_factory=list)
    attachments: list[RecordPlace] = field(default_factory=list)
    indexed: Counter[int] = field(default_factory=Counter)
    """Number of messages by the offset of their chunk, from the message indices."""
    end: str = ""
    """Why the file could not be read to its end; empty where it could."""


@dataclass
class _Salvage:
    """Definitions, counts and losses of the chunks saved so far."""

    schemas: dict[int, Schema] = field(default_factory=dict)
    """All known ones by id, written or not; likewise the channels."""
    channels: dict[int, Channel] = field(default_factory=dict)
    written: set[int] = field(default_factory=set)
    """Ids of the channels whose definition is in the new file."""
    counts: Counter[int] = field(default_factory=Counter)
    times_ns: list[int] = field(default_factory=list)
    damages: list[str] = field(default_factory=list)
    """One for each chunk that could not be read."""
    lost_messages: int = 0
    restored: int = 0
    """Messages of unreadable chunks that were taken from their second copies."""
    latched: list[ChannelMessage] = field(default_factory=list)
    """The saved messages of latched topics."""
    undefined: int = 0
    """Of the lost messages, those in readable chunks whose channel is defined nowhere."""

    def learn(self, schemas: Iterable[Schema], channels: Iterable[Channel]) -> None:
        """Takes definitions; the first one of an id counts."""
        for schema in schemas:
            self.schemas.setdefault(schema.id, schema)
        for channel in channels:
            self.channels.setdefault(channel.id, channel)

    def take(self, content: ChunkContent) -> ChunkContent:
        """The part of a chunk that can be written, with the definitions that the new file still lacks."""
        self.learn(content.schemas, content.channels)
        known = {key for key, channel in self.channels.items() if channel.schema_id in self.schemas}
        messages = tuple(item for item in content.messages if item.channel_id in known)
        self.undefined += len(content.messages) - len(messages)
        self.lost_messages += len(content.messages) - len(messages)
        own = tuple(item for item in content.channels if item.id in known)
        lacking = {item.channel_id for item in messages} - self.written - {item.id for item in own}
        channels = (*(self.channels[key] for key in sorted(lacking)), *own)
        present = {item.id for item in content.schemas} | {self.channels[key].schema_id for key in self.written}
        schemas = {self.channels[key].schema_id for key in lacking} - present
        self.written.update(item.id for item in channels)
        self.counts.update(item.channel_id for item in messages)
        self.latched += (item for item in messages if _is_latched(self.channels[item.channel_id]))
        for item in messages:
            self.times_ns = [min([item.time_ns, *self.times_ns[:1]]), max([item.time_ns, *self.times_ns[1:]])]
        return ChunkContent((*(self.schemas[key] for key in sorted(schemas)), *content.schemas), channels, messages)

    def topics(self) -> list[BagTopic]:
        """The saved topics as the metadata lists them."""
        return [
            BagTopic(
                channel.topic,
                self.schemas[channel.schema_id].name,
                channel.metadata.get("topic_type_hash", ""),
                _is_latched(channel),
                self.counts[key],
            )
            for key, channel in self.channels.items()
            if key in self.written
        ]

    def count_of(self, topic: str) -> int:
        """Number of saved messages of a topic."""
        return sum(self.counts[key] for key, channel in self.channels.items() if channel.topic == topic)


def _is_latched(channel: Channel) -> bool:
    return "transient_local" in channel.metadata.get("offered_qos_profiles", "")


def recover_bag(path: Path, out: Path | None = None) -> Recovery:
    """Writes a complete bag from what can be read of a damaged one.

    Latched messages of damaged chunks, such as the description and the map, are taken from their second copies.

    Args:
        path: Folder of the bag: complete, partial, or the hidden ``.NAME.partial`` of a killed writer; also the
            name that the bag was to have.
        out: New folder; by default the first free one of ``NAME.partial``, ``NAME.partial-2``, … The hidden folder
            of a killed writer then goes away; any other folder stays as it is.

    Raises:
        BagError: There is no bag, it is being written now, it holds nothing that can be saved, or ``out`` exists.
        EpisodeError: The recovered bag cannot be written.
    """
    folder = _folder_of(path)
    files = storage_files(folder)
    if len(files) != 1:
        raise BagError(str(path), "a folder with one .mcap file")
    if (healthy := _as_it_is(folder)) is not None:
        return healthy
    if out is not None and out.exists():
        raise BagError(str(out), "the path of a new folder; this one exists already")
    target = out or free_partial_path(_final_path(folder))
    try:
        with files[0].open("rb", buffering=0) as held:
            if not lock(held):
                raise BagError(str(path), "a bag that no episode is writing now")
            salvage, lost = _write(files[0], target)
        if out is None and folder == working_path(_final_path(folder)):
            _remove_working_folder(folder)
    except OSError as error:
        raise EpisodeError(f"the bag {target} cannot be written: {error.strerror or error}") from error
    described = salvage.count_of(EPISODE.name) > 0 and salvage.count_of(MAP.name) > 0
    saved, steps = sum(salvage.counts.values()), salvage.count_of(ACTORS.name)
    return Recovery(target, saved, steps, False, salvage.lost_messages, lost, described, salvage.restored)


def _folder_of(path: Path) -> Path:
    for folder in (path, working_path(path), path.with_name(path.name + PARTIAL_SUFFIX)):
        if folder.is_dir():
            return folder
    raise BagError(str(path), "a folder that exists, of a recorded episode")


def _final_path(folder: Path) -> Path:
    name = folder.name.split(PARTIAL_SUFFIX)[0]
    return folder.with_name(name.removeprefix(".") or folder.name)


def _as_it_is(folder: Path) -> Recovery | None:
    """The bag itself where it is complete: metadata, summary and every chunk."""
    try:
        check_bag_files(folder, content=True)
        counts = read_message_counts(folder)
    except BagError:
        return None
    return Recovery(folder, sum(counts.values()), counts.get(ACTORS.name, 0), True)


def _write(source: Path, target: Path) -> tuple[_Salvage, str]:
    """Writes the new bag; returns what was saved, and what was lost as text."""
    working = target.with_name(f".{target.name.removeprefix('.')}.recovering")
    working.mkdir(parents=True)
    name = f"{_final_path(target).name}_0.mcap"
    try:
        salvage, lost = _write_storage(source, working / name)
        first_ns, last_ns = (salvage.times_ns or [0, 0])[:2]
        custom = {END_KEY: "partial", REASON_KEY: _REASON}
        text = metadata_text(name, salvage.topics(), first_ns, last_ns, custom)
        (working / METADATA_FILE).write_text(text, encoding="utf-8")
        working.rename(target)
    except BaseException:
        for file_name in (name, METADATA_FILE):
            (working / file_name).unlink(missing_ok=True)
        working.rmdir()
        raise
    return salvage, lost


def _write_storage(source: Path, target: Path) -> tuple[_Salvage, str]:
    salvage = _Salvage()
    with source.open("rb") as file, target.open("wb", buffering=0) as output:
        stream = McapStream(output, BagOptions().compression_level)
        chunks = _find_chunks(file, salvage)
        copies = _lost_copies(file, chunks, salvage)
        for number, place in enumerate(chunks.places):
            try:
                _save_chunk(file, place, stream, salvage)
            except DamageError as error:
                salvage.damages.append(str(error))
                salvage.lost_messages += chunks.indexed[place.offset]
                beyond = _first_time_ns(file, chunks.places[number + 1 :])
                copies = _restore(copies, beyond, stream, salvage)
        _restore(copies, math.inf, stream, salvage)
        salvage.lost_messages = max(0, salvage.lost_messages - salvage.restored)
        if not salvage.counts:
            reasons = "; ".join([*salvage.damages[:1], *([chunks.end] if chunks.end else [])])
            raise BagError(str(source), f"a file with at least one whole chunk ({reasons or 'there is none'})")
        stream.attach_copies(salvage.latched)
        stream.finish()
    with suppress(BagError):
        expected = sum(read_message_counts(source.parent).values())
        salvage.lost_messages = max(salvage.lost_messages, expected - sum(salvage.counts.values()))
    return salvage, _lost_text(salvage, chunks)


def _lost_copies(file: BinaryIO, chunks: _Chunks, salvage: _Salvage) -> list[ChannelMessage]:
    """The messages with second copies whose chunks cannot be read, in the order of the bag."""
    contents = read_copies(file, chunks.attachments)
    if not contents:
        return []
    present: set[tuple[int, int]] = set()
    for place in chunks.places:
        with suppress(DamageError):
            content = parse_content(unpack(read_chunk(file, place)))
            present.update((item.channel_id, item.sequence) for item in content.messages)
    found = []
    for content in contents:
        salvage.learn(content.schemas, content.channels)
        known = {channel.id for channel in content.channels if salvage.channels[channel.id] == channel}
        found += [
            item
            for item in content.messages
            if item.channel_id in known and (item.channel_id, item.sequence) not in present
        ]
    return found


def _first_time_ns(file: BinaryIO, places: Sequence[RecordPlace]) -> float:
    """Time of the first message in the first readable chunk; infinite without one."""
    for place in places:
        with suppress(DamageError):
            messages = parse_content(unpack(read_chunk(file, place))).messages
            if messages:
                return messages[0].time_ns
    return math.inf


def _restore(
    copies: list[ChannelMessage], beyond_ns: float, stream: McapStream, salvage: _Salvage
) -> list[ChannelMessage]:
    """Writes the copies up to a time in the place of a damaged chunk; returns the others."""
    content = salvage.take(ChunkContent((), (), tuple(item for item in copies if item.time_ns <= beyond_ns)))
    stream.adopt_chunk(content, None)
    salvage.restored += len(content.messages)
    return [item for item in copies if item.time_ns > beyond_ns]


def _find_chunks(file: BinaryIO, salvage: _Salvage) -> _Chunks:
    """The chunks by the summary, or else as far as the records follow each other; learns all definitions."""
    chunks = _Chunks()
    size = file.seek(0, 2)
    try:
        summary = read_summary(file, size)
    except DamageError:
        summary = None
    if summary is not None:
        salvage.learn(summary.schemas.values(), summary.channels.values())
        _take_index(file, size, summary, chunks)
        chunks.attachments = [
            RecordPlace(Opcode.ATTACHMENT, index.offset, index.length - _RECORD_HEAD_BYTES)
            for index in summary.attachment_indexes
            if index.length >= _RECORD_HEAD_BYTES
        ]
        return chunks
    try:
        file.seek(0)
        for place in read_places(file, named=False):
            if place.opcode == Opcode.CHUNK:
                chunks.places.append(place)
            elif place.opcode == Opcode.ATTACHMENT:
                chunks.attachments.append(place)
            elif place.opcode == Opcode.MESSAGE_INDEX and chunks.places:
                chunks.indexed[chunks.places[-1].offset] += count_index_entries(file, place.offset)
    except DamageError as error:
        chunks.end = str(error)
    for place in chunks.places:
        with suppress(DamageError):
            content = parse_content(unpack(read_chunk(file, place)))
            salvage.learn(content.schemas, content.channels)
    return chunks


def _take_index(file: BinaryIO, size: int, summary: Summary, chunks: _Chunks) -> None:
    """Takes the chunks of a summary's index, without those that overlap or lie outside the file."""
    end = 0
    for index in sorted(summary.chunk_indexes, key=lambda item: item.chunk_start_offset):
        beyond = index.chunk_start_offset + index.chunk_length
        if index.chunk_start_offset < end or beyond > size or index.chunk_length < _RECORD_HEAD_BYTES:
            continue
        end = beyond
        place = RecordPlace(Opcode.CHUNK, index.chunk_start_offset, index.chunk_length - _RECORD_HEAD_BYTES)
        chunks.places.append(place)
        for offset in index.message_index_offsets.values():
            chunks.indexed[place.offset] += count_index_entries(file, offset)


def _lost_text(salvage: _Salvage, chunks: _Chunks) -> str:
    reasons = []
    if salvage.damages:
        number = f"{len(salvage.damages)} of {len(chunks.places)} chunks"
        first = "" if len(salvage.damages) == 1 else "the first: "
        reasons.append(f"{number} cannot be read ({first}{salvage.damages[0]})")
    if salvage.undefined:
        reasons.append(f"{salvage.undefined} messages are of topics that are defined nowhere")
    if chunks.end:
        reasons.append(chunks.end)
    return "; ".join(reasons)


def _save_chunk(file: BinaryIO, place: RecordPlace, stream: McapStream, salvage: _Salvage) -> None:
    chunk = read_chunk(file, place)
    plain = unpack(chunk)
    content = salvage.take(parse_content(plain))
    unchanged = chunk.compression == "zstd" and plain_bytes(content) == plain
    stream.adopt_chunk(content, chunk.packed if unchanged else None)


def _remove_working_folder(folder: Path) -> None:
    for file in (*storage_files(folder), folder / RESERVE_FILE, folder / METADATA_FILE):
        file.unlink(missing_ok=True)
    with suppress(OSError):  # something else lies in it, which is not ours to remove
        folder.rmdir()
