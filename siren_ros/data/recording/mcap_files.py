"""MCAP files: written chunk by chunk, and read with a check of each chunk up to where a file is damaged.

The record types are those of the ``mcap`` package. Its writer and that of rosbags compress with a fixed level in the
caller's thread. ``McapStream`` takes whole chunks, so that another thread can serialise, compress and write them.

Only what the recorder writes is read: messages in chunks, compressed with zstd or not at all. Every length is compared
with the bytes of the file, so that a damaged or hostile file costs no more memory than the largest chunk allowed.
Format: https://mcap.dev/spec
"""

import struct
import zlib
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from io import SEEK_END, BytesIO, RawIOBase
from typing import BinaryIO, Final, NamedTuple, TypeVar, cast

import zstandard
from mcap import records as mcap
from mcap.data_stream import ReadDataStream, RecordBuilder
from mcap.exceptions import EndOfFile
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, McapRecord, Schema

MAGIC: Final = b"\x89MCAP0\r\n"
PROFILE: Final = "ros2"
LIBRARY: Final = "siren_ros"
COPIES_NAME: Final = "published_once.mcap"
"""Name of the attachment with the second copies of latched messages."""
_COPIES_TYPE: Final = "application/mcap"
_COMPRESSION: Final = "zstd"
_MESSAGE_HEADER: Final = struct.Struct("<BQHIQQ")
_MESSAGE_FIELDS_BYTES: Final = 22
"""Size of channel, sequence and two times, which the format counts as part of a message."""
_SMALL_BYTES: Final = 256_000
"""Chunks up to this uncompressed size use ``_SMALL_LEVEL``; larger ones are sweeps or images."""
_LARGE: Final = zstandard.ZstdCompressionParameters(
    window_log=21,
    chain_log=18,
    hash_log=17,
    search_log=1,
    min_match=4,
    target_length=0,
    strategy=zstandard.STRATEGY_DFAST,
)
"""Compression of large chunks: two hash tables that find matches of four bytes, which is a coordinate that an earlier
point has too. LiDAR sweeps compress at 250 MB/s on one core to 24 %; level −2 reaches 520 MB/s and 32 %, level 3 300
MB/s and 27 %, level 9 70 MB/s and 24 %."""
_SMALL_LEVEL: Final = 3
"""Compression of small chunks, zstd's default. Together they are then as small as chunks of 1 MB at level −2."""


class ChannelMessage(NamedTuple):
    """One message of a chunk."""

    channel_id: int
    sequence: int
    time_ns: int
    data: bytes


@dataclass(frozen=True)
class ChunkContent:
    """Records of one chunk: schemas and channels, new to the file or repeated, then messages."""

    schemas: tuple[Schema, ...]
    channels: tuple[Channel, ...]
    messages: tuple[ChannelMessage, ...]


class McapStream:
    """Writes an MCAP file to a binary stream; the same chunks give the same bytes.

    The stream must be unbuffered (``buffering=0``). The operating system then has every finished chunk, and the
    file of a killed writer can be read up to its last whole chunk.
    """

    def __init__(self, stream: RawIOBase | BytesIO) -> None:
        """Write the head of the file to an empty stream."""
        self._stream = stream
        self._position = 0
        self._whole = 0
        # One thread and no dictionary, so that the compressed bytes depend on the content alone.
        self._large = zstandard.ZstdCompressor(compression_params=_LARGE)
        self._small = zstandard.ZstdCompressor(level=_SMALL_LEVEL, threads=0)
        self._schemas: dict[int, Schema] = {}
        self._channels: dict[int, Channel] = {}
        self._chunks: list[mcap.ChunkIndex] = []
        self._attachments: list[mcap.AttachmentIndex] = []
        self._counts: dict[int, int] = {}
        self._write(MAGIC + _bytes_of([mcap.Header(PROFILE, LIBRARY)]))
        self._whole = self._position

    @property
    def counts(self) -> dict[int, int]:
        """Number of messages by channel id, for every channel in the file."""
        return {channel.id: self._counts.get(channel.id, 0) for channel in self._channels.values()}

    @property
    def span_ns(self) -> tuple[int, int]:
        """Times of the first and the last message in the file; zeros without messages."""
        filled = [chunk for chunk in self._chunks if chunk.message_index_offsets]
        first_ns = min((chunk.message_start_time for chunk in filled), default=0)
        return first_ns, max((chunk.message_end_time for chunk in filled), default=0)

    def rewind(self) -> None:
        """Cut the file after its last complete chunk, because readers stop at an incomplete record."""
        self._attachments.clear()
        self._stream.truncate(self._whole)
        self._stream.seek(self._whole)
        self._position = self._whole

    def _write(self, data: bytes) -> None:
        left = memoryview(data)
        while left:
            left = left[self._stream.write(left) :]
        self._position += len(data)

    def write_chunk(self, content: ChunkContent, packed: bytes | None = None) -> None:
        """Write one chunk and the index of its messages; OSError if the disk refuses it.

        An empty chunk is not written. ``packed`` is the content as it was compressed before; None to compress it here.
        """
        if not content.messages and not content.channels and not content.schemas:
            return
        offset = definitions_bytes(content.schemas, content.channels)
        index: dict[int, list[tuple[int, int]]] = {}
        for message in content.messages:
            index.setdefault(message.channel_id, []).append((message.time_ns, offset))
            offset += message_bytes(message.data)
        times = [message.time_ns for message in content.messages]
        plain = plain_bytes(content)
        if packed is None:
            packed = (self._small if len(plain) <= _SMALL_BYTES else self._large).compress(plain)
        self._write_packed(plain, packed, index, (min(times, default=0), max(times, default=0)))
        for schema in content.schemas:
            self._schemas.setdefault(schema.id, schema)
        for channel in content.channels:
            self._channels.setdefault(channel.id, channel)
        for channel_id, records in index.items():
            self._counts[channel_id] = self._counts.get(channel_id, 0) + len(records)

    def _write_packed(
        self, plain: bytes, packed: bytes, index: dict[int, list[tuple[int, int]]], span_ns: tuple[int, int]
    ) -> None:
        name = _COMPRESSION.encode()
        # The head of the chunk record is packed here, so that the compressed bytes are not copied into it.
        fields = struct.pack("<QQQII", *span_ns, len(plain), zlib.crc32(plain), len(name)) + name
        fields += struct.pack("<Q", len(packed))
        head = struct.pack("<BQ", Opcode.CHUNK, len(fields) + len(packed)) + fields
        start, length = self._position, len(head) + len(packed)
        offsets, indices = {}, b""
        for channel_id, records in index.items():
            offsets[channel_id] = start + length + len(indices)
            indices += _bytes_of([mcap.MessageIndex(channel_id, records)])
        for data in (head, packed, indices):
            self._write(data)
        self._whole = self._position
        self._chunks.append(
            mcap.ChunkIndex(
                chunk_length=length,
                chunk_start_offset=start,
                compression=_COMPRESSION,
                compressed_size=len(packed),
                message_end_time=span_ns[1],
                message_index_length=len(indices),
                message_index_offsets=offsets,
                message_start_time=span_ns[0],
                uncompressed_size=len(plain),
            )
        )

    def attach_copies(self, messages: Sequence[ChannelMessage]) -> None:
        """Write messages of latched topics a second time after all chunks, as an MCAP file in an attachment.

        They are of latched topics, which are published once: without them the bag is no episode. Readers of messages do
        not see attachments, so every count and every player stays as it is. Raises OSError: the disk refuses it.
        """
        if not messages:
            return
        channels = [self._channels[key] for key in sorted({message.channel_id for message in messages})]
        schemas = [self._schemas[key] for key in sorted({channel.schema_id for channel in channels})]
        file = BytesIO()
        copies = McapStream(file)
        copies.write_chunk(ChunkContent(tuple(schemas), tuple(channels), tuple(messages)))
        copies.finish()
        data, time_ns, start = file.getvalue(), messages[0].time_ns, self._position
        record = _bytes_of([mcap.Attachment(time_ns, time_ns, COPIES_NAME, _COPIES_TYPE, data)])
        self._write(record)
        index = mcap.AttachmentIndex(start, len(record), time_ns, time_ns, len(data), COPIES_NAME, _COPIES_TYPE)
        self._attachments.append(index)

    def finish(self) -> None:
        """Write the summary and the end of the file; the stream stays open."""
        self._write(_bytes_of([mcap.DataEnd(0)]))
        summary_start = self._position
        groups: tuple[tuple[Opcode, Sequence[McapRecord]], ...] = (
            (Opcode.SCHEMA, list(self._schemas.values())),
            (Opcode.CHANNEL, list(self._channels.values())),
            (Opcode.STATISTICS, [self._statistics()]),
            (Opcode.CHUNK_INDEX, self._chunks),
            *([(Opcode.ATTACHMENT_INDEX, self._attachments)] if self._attachments else []),
        )
        summary, offsets = b"", []
        for opcode, records in groups:
            data = _bytes_of(records)
            offsets.append(mcap.SummaryOffset(opcode, summary_start + len(summary), len(data)))
            summary += data
        offset_start = summary_start + len(summary)
        summary += _bytes_of(offsets)
        footer_head = struct.pack("<BQQQ", Opcode.FOOTER, 20, summary_start, offset_start)
        crc = zlib.crc32(footer_head, zlib.crc32(summary))
        self._write(summary + _bytes_of([mcap.Footer(summary_start, offset_start, crc)]) + MAGIC)

    def _statistics(self) -> mcap.Statistics:
        first_ns, last_ns = self.span_ns
        return mcap.Statistics(
            attachment_count=len(self._attachments),
            channel_count=len(self._channels),
            channel_message_counts=dict(sorted(self._counts.items())),
            chunk_count=len(self._chunks),
            message_count=sum(self._counts.values()),
            metadata_count=0,
            message_start_time=first_ns,
            message_end_time=last_ns,
            schema_count=len(self._schemas),
        )


def definitions_bytes(schemas: Sequence[Schema], channels: Sequence[Channel]) -> int:
    """Size of some definitions in a chunk, uncompressed."""
    return len(_bytes_of([*schemas, *channels]))


def message_bytes(data: bytes) -> int:
    """Uncompressed size of a message in a chunk, with its head."""
    return _MESSAGE_HEADER.size + len(data)


def plain_bytes(content: ChunkContent) -> bytes:
    """The uncompressed bytes of a chunk."""
    parts = [_bytes_of([*content.schemas, *content.channels])]
    for message in content.messages:
        size, times_ns = _MESSAGE_FIELDS_BYTES + len(message.data), (message.time_ns, message.time_ns)
        head = _MESSAGE_HEADER.pack(Opcode.MESSAGE, size, message.channel_id, message.sequence, *times_ns)
        parts += [head, message.data]
    return b"".join(parts)


def _bytes_of(records: Sequence[McapRecord]) -> bytes:
    builder = RecordBuilder()
    for record in records:
        record.write(builder)
    data: bytes = builder.end()  # type: ignore[no-untyped-call] # mcap leaves this one without annotations
    return data


MAX_CHUNK_BYTES: Final = 256_000_000
"""Largest uncompressed chunk that is read. The recorder writes chunks of 1 MB, plus one message at most."""
_BLOCK_BYTES: Final = 1 << 17
"""Largest uncompressed zstd block (RFC 8878, section 3.1.1.2.4)."""
_REPEATED_BYTE: Final = 1
_COMPRESSED_BLOCK: Final = 2
_RECORD: Final = struct.Struct("<BQ")
_CHUNK: Final = struct.Struct("<QQQII")
_MESSAGE: Final = struct.Struct("<HIQQ")
_LENGTH: Final = struct.Struct("<Q")
_CRC: Final = struct.Struct("<I")
_INDEX_HEAD: Final = struct.Struct("<BQHI")
_INDEX_FIELDS_BYTES: Final = 6
_INDEX_ENTRY_BYTES: Final = 16
_DATA: Final = frozenset({Opcode.HEADER, Opcode.CHUNK, Opcode.MESSAGE_INDEX, Opcode.METADATA, Opcode.ATTACHMENT})
Record = TypeVar("Record", Schema, Channel, Attachment)


class DamageError(ValueError):
    """Raised where the file breaks its format; the message names the place."""


@dataclass(frozen=True)
class RecordPlace:
    """Place of one complete record in the file."""

    opcode: int
    offset: int
    """Offset of the record's first byte."""
    length: int
    """Length of the record's content, without opcode and length."""


@dataclass(frozen=True)
class PackedChunk:
    """One complete chunk record."""

    offset: int
    """Offset of the record in the file."""
    compression: str
    packed: bytes
    plain_bytes: int
    """Uncompressed size that the record states; at most ``MAX_CHUNK_BYTES``."""
    crc: int


def read_places(file: BinaryIO, named: bool = True) -> Iterator[RecordPlace]:
    """Find the records of a file, from its start to the end of its data.

    A file that is ``named`` has to begin with the format's name. Raises DamageError: the file is cut off, or a
    record's head is damaged. All places before have been returned.
    """
    size = file.seek(0, SEEK_END)
    file.seek(0)
    if file.read(len(MAGIC)) != MAGIC and named:
        raise DamageError("no MCAP file")
    offset = len(MAGIC)
    while True:
        file.seek(offset)
        head = file.read(_RECORD.size)
        if len(head) < _RECORD.size:
            raise DamageError(f"the file ends at byte {size} within its data")
        opcode, length = _RECORD.unpack(head)
        end = offset + _RECORD.size + length
        if opcode == Opcode.DATA_END:
            return
        if opcode not in _DATA or end > size:
            raise DamageError(f"no whole record of a bag with chunks at byte {offset} of {size}")
        yield RecordPlace(opcode, offset, length)
        offset = end


def read_chunk(file: BinaryIO, place: RecordPlace) -> PackedChunk:
    """Read the chunk at a place. Raises DamageError if the chunk's head or its zstd frame is damaged."""
    file.seek(place.offset + _RECORD.size)
    return _chunk(file.read(place.length), place.offset)


def read_chunks(file: BinaryIO) -> Iterator[PackedChunk]:
    """Read the chunks of a file, from its start to the end of its data.

    Raises DamageError: the file is cut off or damaged. All chunks before that place have been returned.
    """
    for place in read_places(file):
        if place.opcode == Opcode.CHUNK:
            yield read_chunk(file, place)


def read_attachment(file: BinaryIO, place: RecordPlace) -> Attachment:
    """Read the attachment at a place. Raises DamageError if it is damaged, or larger than the largest chunk."""
    if place.length > MAX_CHUNK_BYTES:
        raise DamageError(f"an attachment of {place.length} bytes; {MAX_CHUNK_BYTES} are allowed")
    file.seek(place.offset + _RECORD.size)
    data = file.read(place.length)
    crc = _CRC.unpack(data[-_CRC.size :])[0] if len(data) >= _CRC.size else -1
    if len(data) < place.length or crc not in {0, zlib.crc32(data[: -_CRC.size])}:
        raise DamageError(f"the attachment at byte {place.offset} does not have its checksum")
    return _parsed(Attachment, data)


def read_copies(file: BinaryIO, places: Iterable[RecordPlace]) -> list[ChunkContent]:
    """Read the second copies of latched messages in a file's attachments, as far as they are undamaged.

    ``McapStream.attach_copies`` writes them; attachments of other kinds are left out.
    """
    copies = []
    for place in places:
        with suppress(DamageError):
            attachment = read_attachment(file, place)
            if attachment.name == COPIES_NAME:
                copies += [parse_content(unpack(chunk)) for chunk in read_chunks(BytesIO(attachment.data))]
    return copies


def count_index_entries(file: BinaryIO, offset: int) -> int:
    """Number of messages in the message index record at an offset; 0 where the record is damaged."""
    file.seek(offset)
    head = file.read(_INDEX_HEAD.size)
    if len(head) < _INDEX_HEAD.size:
        return 0
    opcode, length, _, entries_bytes = _INDEX_HEAD.unpack(head)
    whole = opcode == Opcode.MESSAGE_INDEX and entries_bytes == length - _INDEX_FIELDS_BYTES
    return entries_bytes // _INDEX_ENTRY_BYTES if whole and entries_bytes % _INDEX_ENTRY_BYTES == 0 else 0


def _chunk(data: bytes, offset: int) -> PackedChunk:
    if len(data) < _CHUNK.size:
        raise DamageError(f"a chunk of {len(data)} bytes at byte {offset}")
    _, _, plain_bytes, crc, name_bytes = _CHUNK.unpack_from(data)
    at = _CHUNK.size + name_bytes
    if at + _LENGTH.size > len(data) or at + _LENGTH.size + _LENGTH.unpack_from(data, at)[0] != len(data):
        raise DamageError(f"a chunk at byte {offset} whose lengths contradict each other")
    if plain_bytes > MAX_CHUNK_BYTES:
        raise DamageError(f"a chunk at byte {offset} that claims {plain_bytes} bytes; {MAX_CHUNK_BYTES} are allowed")
    compression = data[_CHUNK.size : at].decode("ascii", "replace")
    packed = data[at + _LENGTH.size :]
    if compression == "zstd":
        claimed = _frame_size(packed, offset)
    elif compression == "":
        claimed = len(packed)
    else:
        raise DamageError(f"a chunk at byte {offset} with the compression {compression!r}; zstd and none are read")
    if claimed != plain_bytes:
        raise DamageError(f"a chunk at byte {offset} that claims {plain_bytes} bytes and holds {claimed}")
    return PackedChunk(offset, compression, packed, plain_bytes, crc)


def _frame_size(packed: bytes, offset: int) -> int:
    """Uncompressed size of a chunk's zstd frame; DamageError where its blocks can unpack to much more (RFC 8878)."""
    try:
        frame = zstandard.get_frame_parameters(packed)
        at = zstandard.frame_header_size(packed)
    except zstandard.ZstdError as error:
        raise DamageError(f"a chunk at byte {offset} that is not zstd's: {error}") from error
    largest, last = 0, False
    while not last:
        if at + 3 > len(packed):
            raise DamageError(f"a chunk at byte {offset} that ends within its compressed data")
        block = int.from_bytes(packed[at : at + 3], "little")
        last, kind, size = bool(block & 1), block >> 1 & 3, block >> 3
        largest += _BLOCK_BYTES if kind == _COMPRESSED_BLOCK else size
        at += 3 + (1 if kind == _REPEATED_BYTE else size)
    if at + (4 if frame.has_checksum else 0) != len(packed) or largest > 2 * MAX_CHUNK_BYTES:
        raise DamageError(f"a chunk at byte {offset} that is more than one frame of at most {MAX_CHUNK_BYTES} bytes")
    return int(frame.content_size)


def unpack(chunk: PackedChunk) -> bytes:
    """The uncompressed content of a chunk.

    Raises DamageError: the chunk cannot be unpacked, or its checksum is wrong.
    """
    plain = chunk.packed
    if chunk.compression:
        try:
            plain = zstandard.ZstdDecompressor().decompress(chunk.packed, max_output_size=chunk.plain_bytes)
        except zstandard.ZstdError as error:
            raise DamageError(f"the chunk at byte {chunk.offset}: {error}") from error
    if len(plain) != chunk.plain_bytes or (chunk.crc and zlib.crc32(plain) != chunk.crc):
        raise DamageError(f"the chunk at byte {chunk.offset} does not have its checksum")
    return plain


def parse_content(plain: bytes) -> ChunkContent:
    """Parse a chunk into schemas, channels and messages.

    Raises DamageError: the records contradict the chunk's size, or are of another kind.
    """
    schemas, channels, messages = [], [], []
    offset = 0
    while offset < len(plain):
        if offset + _RECORD.size > len(plain):
            raise DamageError("a chunk that ends within a record")
        opcode, length = _RECORD.unpack_from(plain, offset)
        start, offset = offset + _RECORD.size, offset + _RECORD.size + length
        if offset > len(plain):
            raise DamageError("a record that is longer than its chunk")
        data = plain[start:offset]
        if opcode == Opcode.MESSAGE and length >= _MESSAGE.size:
            channel_id, sequence, time_ns, _ = _MESSAGE.unpack_from(data)
            messages.append(ChannelMessage(channel_id, sequence, time_ns, data[_MESSAGE.size :]))
        elif opcode == Opcode.SCHEMA:
            schemas.append(_parsed(Schema, data))
        elif opcode == Opcode.CHANNEL:
            channels.append(_parsed(Channel, data))
        else:
            raise DamageError(f"a record with the code {opcode} in a chunk")
    return ChunkContent(tuple(schemas), tuple(channels), tuple(messages))


def _parsed(kind: type[Record], data: bytes) -> Record:
    try:
        return cast("Record", kind.read(ReadDataStream(BytesIO(data))))
    except (EndOfFile, UnicodeDecodeError, struct.error) as error:
        raise DamageError(f"a broken {kind.__name__.lower()} record") from error
