"""Repairs a bag whose writer was killed or whose file is damaged: it keeps all complete chunks and writes a summary."""

import math
from collections import Counter
from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO, Final

from mcap.opcode import Opcode
from mcap.records import Channel, Schema
from mcap.summary import Summary

from siren_ros.data.interfaces.topics import ACTORS, EPISODE, MAP
from siren_ros.data.recording import bag_folder, mcap_files
from siren_ros.data.recording.bag_folder import (
    METADATA_FILE,
    PARTIAL_SUFFIX,
    BagTopic,
    read_message_counts,
    working_path,
)
from siren_ros.data.recording.bag_reader import check_bag_files, read_summary, storage_files
from siren_ros.data.recording.bag_writer import END_KEY, REASON_KEY
from siren_ros.data.recording.mcap_files import (
    ChannelMessage,
    ChunkContent,
    DamageError,
    McapStream,
    RecordPlace,
    plain_bytes,
)
from siren_ros.errors import BagError, EpisodeError

_REASON: Final = "recovered after its writer was cut off"
_RECORD_HEAD_BYTES: Final = 9


@dataclass(frozen=True)
class Recovery:
    """The result of a recovery."""

    path: Path
    messages: int
    steps: int
    healthy: bool
    """Whether the bag was complete already; nothing was written then."""
    lost_messages: int = 0
    """Number of messages that could not be saved, as far as the damaged file shows it."""
    lost: str = ""
    """What could not be saved, and why; empty if nothing was lost."""
    described: bool = True
    """Whether the episode's description and map were saved; without them the bag is not an episode."""
    restored: int = 0
    """Number of messages restored from their second copies, because their chunks are unreadable."""


@dataclass
class _Salvage:
    """What can be saved from one damaged file, and what is lost."""

    file: BinaryIO
    stream: McapStream
    """The new file."""
    chunks: list[RecordPlace] = field(default_factory=list)
    attachments: list[RecordPlace] = field(default_factory=list)
    indexed: Counter[int] = field(default_factory=Counter)
    """Number of messages by the offset of their chunk, from the message indices."""
    end: str = ""
    """Why the file could not be read to its end; empty if it could."""
    schemas: dict[int, Schema] = field(default_factory=dict)
    """All known schemas by id, written or not; the same for the channels below."""
    channels: dict[int, Channel] = field(default_factory=dict)
    written: set[int] = field(default_factory=set)
    """Ids of the channels whose definition is in the new file."""
    counts: Counter[int] = field(default_factory=Counter)
    damages: list[str] = field(default_factory=list)
    """One text for each chunk that could not be read."""
    lost_messages: int = 0
    restored: int = 0
    """Number of messages restored from second copies, since their chunks are unreadable."""
    latched: list[ChannelMessage] = field(default_factory=list)
    """The saved messages of latched topics."""
    undefined: int = 0
    """How many of the lost messages are in readable chunks whose channel has no definition."""

    def find_chunks(self) -> None:
        """Find the chunks, by the summary or else record by record, and collect all definitions."""
        size = self.file.seek(0, 2)
        try:
            summary = read_summary(self.file, size)
        except DamageError:
            self._scan()
            return
        self._learn(summary.schemas.values(), summary.channels.values())
        self._take_index(size, summary)
        self.attachments = [
            RecordPlace(Opcode.ATTACHMENT, index.offset, index.length - _RECORD_HEAD_BYTES)
            for index in summary.attachment_indexes
            if index.length >= _RECORD_HEAD_BYTES
        ]

    def _scan(self) -> None:
        try:
            self.file.seek(0)
            for place in mcap_files.read_places(self.file, named=False):
                if place.opcode == Opcode.CHUNK:
                    self.chunks.append(place)
                elif place.opcode == Opcode.ATTACHMENT:
                    self.attachments.append(place)
                elif place.opcode == Opcode.MESSAGE_INDEX and self.chunks:
                    self.indexed[self.chunks[-1].offset] += mcap_files.count_index_entries(self.file, place.offset)
        except DamageError as error:
            self.end = str(error)
        for content in self._readable(self.chunks):
            self._learn(content.schemas, content.channels)

    def _take_index(self, size: int, summary: Summary) -> None:
        """Take the chunks of a summary's index, except those that overlap or lie outside the file."""
        end = 0
        for index in sorted(summary.chunk_indexes, key=lambda item: item.chunk_start_offset):
            beyond = index.chunk_start_offset + index.chunk_length
            if index.chunk_start_offset < end or beyond > size or index.chunk_length < _RECORD_HEAD_BYTES:
                continue
            end = beyond
            place = RecordPlace(Opcode.CHUNK, index.chunk_start_offset, index.chunk_length - _RECORD_HEAD_BYTES)
            self.chunks.append(place)
            for offset in index.message_index_offsets.values():
                self.indexed[place.offset] += mcap_files.count_index_entries(self.file, offset)

    def _readable(self, places: Iterable[RecordPlace]) -> Iterator[ChunkContent]:
        """Contents of the chunks that can be read."""
        for place in places:
            with suppress(DamageError):
                yield mcap_files.parse_content(mcap_files.unpack(mcap_files.read_chunk(self.file, place)))

    def _learn(self, schemas: Iterable[Schema], channels: Iterable[Channel]) -> None:
        """Take definitions; the first one of each id counts."""
        for schema in schemas:
            self.schemas.setdefault(schema.id, schema)
        for channel in channels:
            self.channels.setdefault(channel.id, channel)

    def save(self) -> None:
        """Write everything that can be saved to the new file."""
        copies = self._lost_copies()
        for number, place in enumerate(self.chunks):
            try:
                chunk = mcap_files.read_chunk(self.file, place)
                plain = mcap_files.unpack(chunk)
                content = self._take(mcap_files.parse_content(plain))
            except DamageError as error:
                self.damages.append(str(error))
                self.lost_messages += self.indexed[place.offset]
                later = self._readable(self.chunks[number + 1 :])
                first_times_ns = (content.messages[0].time_ns for content in later if content.messages)
                copies = self._restore(copies, next(first_times_ns, math.inf))
            else:
                unchanged = chunk.compression == "zstd" and plain_bytes(content) == plain
                self.stream.write_chunk(content, chunk.packed if unchanged else None)
        self._restore(copies, math.inf)
        self.lost_messages = max(0, self.lost_messages - self.restored)

    def _lost_copies(self) -> list[ChannelMessage]:
        """Second copies of the messages whose chunks cannot be read, in the order of the bag."""
        contents = mcap_files.read_copies(self.file, self.attachments)
        readable = self._readable(self.chunks) if contents else ()
        present = {(item.channel_id, item.sequence) for content in readable for item in content.messages}
        copies: list[ChannelMessage] = []
        for content in contents:
            self._learn(content.schemas, content.channels)
            known = {channel.id for channel in content.channels if self.channels[channel.id] == channel}
            lost = (item for item in content.messages if (item.channel_id, item.sequence) not in present)
            copies += (item for item in lost if item.channel_id in known)
        return copies

    def _restore(self, copies: list[ChannelMessage], beyond_ns: float) -> list[ChannelMessage]:
        """Write the copies up to a time in place of a damaged chunk; returns the others."""
        content = self._take(ChunkContent((), (), tuple(item for item in copies if item.time_ns <= beyond_ns)))
        self.stream.write_chunk(content)
        self.restored += len(content.messages)
        return [item for item in copies if item.time_ns > beyond_ns]

    def _take(self, content: ChunkContent) -> ChunkContent:
        """The part of a chunk that can be written, with the definitions that the new file still lacks."""
        self._learn(content.schemas, content.channels)
        known = {key for key, channel in self.channels.items() if channel.schema_id in self.schemas}
        messages = tuple(item for item in content.messages if item.channel_id in known)
        self.undefined += len(content.messages) - len(messages)
        self.lost_messages += len(content.messages) - len(messages)
        defined = tuple(item for item in content.channels if item.id in known)
        lacking = {item.channel_id for item in messages} - self.written - {item.id for item in defined}
        channels = (*(self.channels[key] for key in sorted(lacking)), *defined)
        present = {item.id for item in content.schemas} | {self.channels[key].schema_id for key in self.written}
        schemas = {self.channels[key].schema_id for key in lacking} - present
        self.written.update(item.id for item in channels)
        self.counts.update(item.channel_id for item in messages)
        self.latched += (item for item in messages if bag_folder.is_latched(self.channels[item.channel_id]))
        return ChunkContent((*(self.schemas[key] for key in sorted(schemas)), *content.schemas), channels, messages)

    def topics(self) -> list[BagTopic]:
        """The saved topics as the metadata lists them."""
        return [
            BagTopic.of_channel(channel, self.schemas[channel.schema_id].name, self.counts[key])
            for key, channel in self.channels.items()
            if key in self.written
        ]

    def count_of(self, topic: str) -> int:
        """Number of saved messages of a topic."""
        return sum(self.counts[key] for key, channel in self.channels.items() if channel.topic == topic)

    def lost_text(self) -> str:
        """What could not be saved, and why."""
        reasons = []
        if self.damages:
            first = self.damages[0] if len(self.damages) == 1 else f"the first: {self.damages[0]}"
            reasons.append(f"{len(self.damages)} of {len(self.chunks)} chunks cannot be read ({first})")
        if self.undefined:
            reasons.append(f"{self.undefined} messages are of topics that are defined nowhere")
        return "; ".join([*reasons, self.end] if self.end else reasons)


def recover_bag(path: Path, out: Path | None = None) -> Recovery:
    """Write a complete bag from the readable part of a damaged one.

    Latched messages of damaged chunks, such as the description and the map, are taken from their second copies.

    Args:
        path: Folder of the bag: complete, partial, or the hidden ``.NAME.partial`` of a killed writer; also the
            name that the bag was to have.
        out: New folder; by default the first free one of ``NAME.partial``, ``NAME.partial-2``, … The hidden folder
            of a killed writer then goes away; any other folder stays as it is.

    Raises BagError: there is no bag, it is being written now, it holds nothing that can be saved, or ``out`` exists.
    Raises EpisodeError: the recovered bag cannot be written.
    """
    folder = _folder_of(path)
    files = storage_files(folder)
    if len(files) != 1:
        raise BagError(str(path), "a folder with one .mcap file")
    with suppress(BagError):  # the bag may be complete already: metadata, summary and each chunk
        check_bag_files(folder, content=True)
        counts = read_message_counts(folder)
        return Recovery(folder, sum(counts.values()), counts.get(ACTORS.name, 0), healthy=True)
    if out is not None and out.exists():
        raise BagError(str(out), "the path of a new folder; this one exists already")
    target = out or bag_folder.free_partial_path(_final_path(folder))
    try:
        with files[0].open("rb", buffering=0) as held:
            if not bag_folder.lock(held):
                raise BagError(str(path), "a bag that no episode is writing now")
            salvage = _write(files[0], target)
        if out is None and folder == working_path(_final_path(folder)):
            _remove_working_folder(folder)
    except OSError as error:
        raise EpisodeError(f"the bag {target} cannot be written: {error.strerror or error}") from error
    return Recovery(
        target,
        messages=sum(salvage.counts.values()),
        steps=salvage.count_of(ACTORS.name),
        healthy=False,
        lost_messages=salvage.lost_messages,
        lost=salvage.lost_text(),
        described=salvage.count_of(EPISODE.name) > 0 and salvage.count_of(MAP.name) > 0,
        restored=salvage.restored,
    )


def _folder_of(path: Path) -> Path:
    for folder in (path, working_path(path), path.with_name(path.name + PARTIAL_SUFFIX)):
        if folder.is_dir():
            return folder
    raise BagError(str(path), "a folder that exists, of a recorded episode")


def _final_path(folder: Path) -> Path:
    name = folder.name.split(PARTIAL_SUFFIX)[0]
    return folder.with_name(name.removeprefix(".") or folder.name)


def _write(source: Path, target: Path) -> _Salvage:
    """Write the new bag."""
    working = target.with_name(f".{target.name.removeprefix('.')}.recovering")
    working.mkdir(parents=True)
    name = f"{_final_path(target).name}_0.mcap"
    try:
        salvage = _write_storage(source, working / name)
        custom = {END_KEY: "partial", REASON_KEY: _REASON}
        text = bag_folder.metadata_text(name, salvage.topics(), *salvage.stream.span_ns, custom)
        (working / METADATA_FILE).write_text(text, encoding="utf-8")
        working.rename(target)
    except BaseException:
        for file_name in (name, METADATA_FILE):
            (working / file_name).unlink(missing_ok=True)
        working.rmdir()
        raise
    return salvage


def _write_storage(source: Path, target: Path) -> _Salvage:
    with source.open("rb") as file, target.open("wb", buffering=0) as output:
        salvage = _Salvage(file, McapStream(output))
        salvage.find_chunks()
        salvage.save()
        if not salvage.counts:
            reasons = "; ".join([*salvage.damages[:1], *([salvage.end] if salvage.end else [])])
            raise BagError(str(source), f"a file with at least one whole chunk ({reasons or 'there is none'})")
        salvage.stream.attach_copies(salvage.latched)
        salvage.stream.finish()
    with suppress(BagError):
        expected = sum(read_message_counts(source.parent).values())
        salvage.lost_messages = max(salvage.lost_messages, expected - sum(salvage.counts.values()))
    return salvage


def _remove_working_folder(folder: Path) -> None:
    for file in (*storage_files(folder), folder / bag_folder.RESERVE_FILE, folder / METADATA_FILE):
        file.unlink(missing_ok=True)
    with suppress(OSError):  # the folder contains other files, which must stay
        folder.rmdir()
