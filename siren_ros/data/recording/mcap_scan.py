"""Reads the chunks of an MCAP file one by one, checks each, and stops where the file is damaged.

It reads only what the recorder writes: messages in chunks, compressed with zstd or not at all. Every length is compared
with the bytes of the file, so that a damaged or hostile file costs no more memory than the largest chunk allowed.
Format: https://mcap.dev/spec
"""

import struct
import zlib
from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from io import SEEK_END, BytesIO
from typing import BinaryIO, Final, TypeVar, cast

import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import EndOfFile
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Schema

from siren_ros.data.recording.mcap_stream import COPIES_NAME, MAGIC, ChannelMessage, ChunkContent

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
