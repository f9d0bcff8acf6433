"""MCAP files: scanned and streamed."""

import struct
from io import BytesIO
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zstandard
from mcap.opcode import Opcode
from mcap.reader import SeekingReader
from mcap.records import Channel, ChunkIndex, Schema
from mcap.summary import Summary

from siren_ros.data.recording import mcap_files
from siren_ros.data.recording.mcap_files import COPIES_NAME, ChannelMessage, ChunkContent, McapStream, plain_bytes

CONTENT = ChunkContent((), (), (ChannelMessage(1, 0, 5, b"x" * 50), ChannelMessage(1, 1, 6, b"y" * 50)))


@pytest.fixture
def whole(tmp_path: Path) -> Path:
    """Two chunks, each with the index of its one channel."""
    path = tmp_path / "x.mcap"
    with path.open("wb", buffering=0) as file:
        stream = McapStream(file)
        stream.write_chunk(CONTENT)
        stream.write_chunk(CONTENT)
        stream.finish()
    return path


def places_of(path: Path, length: int | None = None) -> tuple[list[mcap_files.RecordPlace], str]:
    """The records of the first bytes of a file, and why there are no more."""
    read: list[mcap_files.RecordPlace] = []
    cut = path.with_name("cut.mcap")
    cut.write_bytes(path.read_bytes()[:length])
    with cut.open("rb") as file:
        places = mcap_files.read_places(file)
        try:
            while (place := next(places, None)) is not None:
                read.append(place)
        except mcap_files.DamageError as error:
            return read, str(error)
    return read, ""


def test_a_whole_file_is_read_up_to_the_end_of_its_data(whole):
    places, why = places_of(whole)
    assert why == ""
    assert [place.opcode for place in places] == [
        Opcode.HEADER,
        Opcode.CHUNK,
        Opcode.MESSAGE_INDEX,
        Opcode.CHUNK,
        Opcode.MESSAGE_INDEX,
    ]
    for before, after in pairwise(places):
        assert after.offset == before.offset + 9 + before.length


def test_a_file_is_read_up_to_its_last_whole_record(whole):
    """A writer that is killed between two records leaves a file that ends right behind one."""
    whole_places, _ = places_of(whole)
    for number, last in list(enumerate(whole_places))[1:]:
        end = last.offset + 9 + last.length
        places, why = places_of(whole, end)
        assert places == whole_places[: number + 1]
        assert "ends at byte" in why
        for missing in (1, 9):
            places, why = places_of(whole, end - missing)
            assert places == whole_places[:number]
            assert f"no whole record of a bag with chunks at byte {last.offset}" in why


def test_what_does_not_begin_like_a_bag_is_none(tmp_path):
    path = tmp_path / "x"
    path.write_bytes(b"PK\x03\x04" * 20)
    with path.open("rb") as file, pytest.raises(mcap_files.DamageError):
        list(mcap_files.read_places(file))


def packed_chunk(packed: bytes, plain_bytes: int, compression: bytes = b"zstd") -> bytes:
    """The content of a chunk's record (MCAP's specification): times, size, checksum, compression, length, data."""
    head = struct.pack("<QQQI", 0, 0, plain_bytes, 0)
    return head + struct.pack("<I", len(compression)) + compression + struct.pack("<Q", len(packed)) + packed


def chunk_with(content: bytes) -> mcap_files.PackedChunk:
    """The chunk of a record at byte 7 of a file; code and length of a record have nine bytes."""
    return mcap_files.read_chunk(BytesIO(bytes(7 + 9) + content), mcap_files.RecordPlace(Opcode.CHUNK, 7, len(content)))


@pytest.mark.parametrize("checksum", [False, True])
@pytest.mark.parametrize("plain", [b"", b"x", bytes(300_000)])
def test_frames_of_any_length_are_measured(plain, checksum):
    """The frame of nothing ends with the head of its one block."""
    packed = zstandard.ZstdCompressor(write_checksum=checksum).compress(plain)
    chunk = chunk_with(packed_chunk(packed, len(plain)))
    assert (chunk.offset, chunk.compression, chunk.packed) == (7, "zstd", packed)
    assert not plain or mcap_files.unpack(chunk) == plain


@pytest.mark.parametrize(
    ("packed", "reason"),
    [
        (lambda frame: frame[:-1], "ends within its compressed data|more than one frame"),
        (lambda frame: frame + b"\0", "more than one frame"),
        (lambda frame: frame + frame, "more than one frame"),
        (lambda frame: frame[:5], "not zstd's|ends within"),
        (lambda _: b"no zstd at all", "not zstd's"),
    ],
    ids=["cut", "one byte more", "two frames", "a head", "none"],
)
def test_what_is_not_just_one_frame_is_refused(packed, reason):
    frame = zstandard.ZstdCompressor().compress(b"abc" * 1000)
    with pytest.raises(mcap_files.DamageError, match=reason):
        chunk_with(packed_chunk(packed(frame), 3000))


def frame_of_repeated_bytes(claimed: int, blocks: list[int]) -> bytes:
    """A zstd frame (RFC 8878, section 3.1.1) that claims a size and repeats one byte so often in each block."""
    head = (0xFD2FB528).to_bytes(4, "little") + bytes([0b1010_0000]) + claimed.to_bytes(4, "little")
    heads = [(length << 3 | 1 << 1 | (number == len(blocks) - 1)) for number, length in enumerate(blocks)]
    return head + b"".join(block.to_bytes(3, "little") + b"x" for block in heads)


@pytest.mark.parametrize("claimed", [3000, mcap_files.MAX_CHUNK_BYTES])
def test_a_small_chunk_that_unpacks_to_more_than_is_allowed_is_refused_unread(claimed):
    """Some 16 kB of blocks whose bytes are twice what a chunk may have; the frame's own claim is harmless."""
    whole, rest = divmod(2 * mcap_files.MAX_CHUNK_BYTES, 1 << 17)
    content, over = (
        packed_chunk(frame_of_repeated_bytes(claimed, [*[1 << 17] * whole, rest + more]), claimed) for more in (0, 1)
    )
    assert len(over) < 20_000
    assert chunk_with(content).plain_bytes == claimed
    with pytest.raises(mcap_files.DamageError, match="more than one frame of at most 256000000 bytes"):
        chunk_with(over)


def test_a_frame_of_repeated_bytes_is_read():
    frame = frame_of_repeated_bytes(300_000, [131_072, 131_072, 37_856])
    assert mcap_files.unpack(chunk_with(packed_chunk(frame, 300_000))) == b"x" * 300_000


@pytest.mark.parametrize("off", [-1, 1])
def test_sizes_that_contradict_the_content_or_each_other_are_refused(off):
    frame, plain = zstandard.ZstdCompressor().compress(b"abc" * 1000), packed_chunk(b"abcd", 4, b"")
    assert chunk_with(plain).packed == b"abcd"
    longer = plain[:-12] + struct.pack("<Q", 4 + off) + plain[-4:]
    for content, reason in (
        (packed_chunk(frame, 3000 + off), f"claims {3000 + off} bytes and holds 3000"),
        (packed_chunk(b"abcd", 4 + off, b""), f"claims {4 + off} bytes and holds 4"),
        *[(broken, "contradict") for broken in (longer, plain[:-1], plain + b"x")],
        (packed_chunk(b"abcd", 4, b"lz4"), "'lz4'; zstd and none"),
        (packed_chunk(b"abcd", 256_000_001, b""), "claims 256000001 bytes; 256000000 are allowed"),
    ):
        with pytest.raises(mcap_files.DamageError, match=reason):
            chunk_with(content)


SCHEMAS = tuple(
    Schema(id=number, name=name, encoding="ros2msg", data=data)
    for number, name, data in ((1, "a/A", b"int32 x"), (2, "b/B", b"int32 y"))
)
CHANNELS = tuple(
    Channel(id=number, topic=topic, message_encoding="cdr", metadata={}, schema_id=schema)
    for number, topic, schema in ((1, "/a", 1), (2, "/b", 2), (3, "/silent", 2))
)
FIRST = ChunkContent(
    SCHEMAS,
    CHANNELS,
    (ChannelMessage(2, 0, 7_000, b"seven"), ChannelMessage(1, 0, 5_000, b"five"), ChannelMessage(2, 1, 6_000, b"")),
)
SECOND = ChunkContent((), (), (ChannelMessage(1, 1, 9_000, b"nine" * 100), ChannelMessage(1, 2, 8_000, b"eight")))
NOTHING_SAID = ChunkContent(SCHEMAS, CHANNELS, ())


def written(path: Path, *chunks: ChunkContent) -> tuple[McapStream, Summary]:
    with path.open("wb", buffering=0) as file:
        stream = McapStream(file)
        for chunk in chunks:
            stream.write_chunk(chunk)
        stream.finish()
    with path.open("rb") as file:
        summary = SeekingReader(file, validate_crcs=True).get_summary()
    assert summary is not None
    return stream, summary


def test_messages_come_back_with_their_times_and_numbers(tmp_path):
    written(tmp_path / "x.mcap", FIRST, SECOND)
    with (tmp_path / "x.mcap").open("rb") as file:
        read = [
            (channel.topic, schema.name, message.log_time, message.publish_time, message.sequence, message.data)
            for schema, channel, message in SeekingReader(file, validate_crcs=True).iter_messages()
        ]
    assert read == [
        ("/a", "a/A", 5_000, 5_000, 0, b"five"),
        ("/b", "b/B", 6_000, 6_000, 1, b""),
        ("/b", "b/B", 7_000, 7_000, 0, b"seven"),
        ("/a", "a/A", 8_000, 8_000, 2, b"eight"),
        ("/a", "a/A", 9_000, 9_000, 1, b"nine" * 100),
    ]


def test_the_statistics_count_and_span_all_messages(tmp_path):
    stream, summary = written(tmp_path / "x.mcap", NOTHING_SAID, FIRST, SECOND)
    statistics = summary.statistics
    assert (statistics.message_count, statistics.chunk_count) == (5, 3)
    assert (statistics.channel_count, statistics.schema_count) == (3, 2)
    assert (statistics.attachment_count, statistics.metadata_count) == (0, 0)
    assert statistics.channel_message_counts == {1: 3, 2: 2}
    assert stream.counts == {1: 3, 2: 2, 3: 0}
    # A chunk of definitions alone has no time of its own.
    assert (statistics.message_start_time, statistics.message_end_time) == stream.span_ns == (5_000, 9_000)


def test_a_file_without_messages_has_no_span_and_an_empty_chunk_is_not_written(tmp_path):
    stream, summary = written(tmp_path / "x.mcap", NOTHING_SAID, ChunkContent((), (), ()))
    assert stream.span_ns == (0, 0)
    assert (summary.statistics.message_count, len(summary.chunk_indexes)) == (0, 1)
    assert written(tmp_path / "y.mcap")[1].chunk_indexes == []


def test_the_index_of_a_chunk_leads_to_its_bytes(tmp_path):
    path = tmp_path / "x.mcap"
    _, summary = written(path, FIRST, SECOND)
    data = path.read_bytes()
    first, second = summary.chunk_indexes
    assert (first.message_start_time, first.message_end_time) == (5_000, 7_000)
    assert (second.message_start_time, second.message_end_time) == (8_000, 9_000)
    assert second.chunk_start_offset == first.chunk_start_offset + first.chunk_length + first.message_index_length
    for index, content in ((first, FIRST), (second, SECOND)):
        assert index.uncompressed_size == len(plain_bytes(content))
        assert data[index.chunk_start_offset] == 0x06
        assert index.compression == "zstd"
        _check_message_index(data, index, content)
    with path.open("rb") as file:
        chunks = [mcap_files.parse_content(mcap_files.unpack(chunk)) for chunk in mcap_files.read_chunks(file)]
    assert chunks == [FIRST, SECOND]
    # Code and length of the record, five numbers, the name of the compression and the length of the content.
    heads = {chunk.chunk_length - chunk.compressed_size for chunk in summary.chunk_indexes}
    assert heads == {9 + 3 * 8 + 2 * 4 + len("zstd") + 8}


def _check_message_index(data: bytes, index: ChunkIndex, content: ChunkContent) -> None:
    """Each entry's offset leads to a message of that channel and time within the uncompressed chunk."""
    plain = plain_bytes(content)
    entries = []
    for channel_id, offset in index.message_index_offsets.items():
        assert data[offset] == 0x07
        size = int.from_bytes(data[offset + 9 + 2 : offset + 9 + 6], "little")
        for place in range(0, size, 16):
            entry = data[offset + 15 + place : offset + 31 + place]
            time_ns, at = int.from_bytes(entry[:8], "little"), int.from_bytes(entry[8:], "little")
            assert plain[at] == 0x05
            assert int.from_bytes(plain[at + 9 : at + 11], "little") == channel_id
            assert int.from_bytes(plain[at + 15 : at + 23], "little") == time_ns
            entries.append((channel_id, time_ns))
    assert sorted(entries) == sorted((message.channel_id, message.time_ns) for message in content.messages)


def test_the_same_chunks_are_the_same_bytes_whoever_packed_them(tmp_path):
    written(tmp_path / "x.mcap", FIRST, SECOND)
    with (tmp_path / "x.mcap").open("rb") as file:
        packed = [chunk.packed for chunk in mcap_files.read_chunks(file)]
    with (tmp_path / "y.mcap").open("wb", buffering=0) as file:
        stream = McapStream(file)
        for content, packed_chunk in zip((FIRST, SECOND), packed, strict=True):
            stream.write_chunk(content, packed_chunk)
        stream.finish()
    assert (tmp_path / "x.mcap").read_bytes() == (tmp_path / "y.mcap").read_bytes()


@pytest.mark.parametrize("chunks", [(), (FIRST,)])
def test_rewinding_cuts_after_the_last_whole_chunk(tmp_path, chunks):
    path = tmp_path / "x.mcap"
    with path.open("wb", buffering=0) as file:
        stream = McapStream(file)
        for chunk in chunks:
            stream.write_chunk(chunk)
        whole = path.stat().st_size
        file.write(b"half a chunk")
        stream.rewind()
        assert path.stat().st_size == whole
        stream.write_chunk(SECOND if chunks else FIRST)
        stream.finish()
    plain, _ = tmp_path / "y.mcap", written(tmp_path / "y.mcap", *(chunks or ()), SECOND if chunks else FIRST)
    assert path.read_bytes() == plain.read_bytes()


class Slow(BytesIO):
    """Takes at most 7 bytes at a time, as a nearly full pipe or disk does."""

    def write(self, data: Any) -> int:
        return super().write(bytes(data[:7]))


def test_a_stream_that_takes_a_part_at_a_time_gets_everything(tmp_path):
    written(tmp_path / "x.mcap", FIRST, SECOND)
    file: Any = Slow()
    stream = McapStream(file)
    for chunk in (FIRST, SECOND):
        stream.write_chunk(chunk)
    stream.finish()
    assert file.getvalue() == (tmp_path / "x.mcap").read_bytes()


def packed_and_plain(path: Path, data: bytes) -> tuple[bytes, bytes]:
    """A message's chunk in the file, and its content."""
    with path.open("w+b", buffering=0) as file:
        stream = McapStream(file)
        stream.write_chunk(ChunkContent(SCHEMAS, CHANNELS, (ChannelMessage(1, 0, 0, data),)))
        stream.finish()
        file.seek(0)
        (chunk,) = mcap_files.read_chunks(file)
    return chunk.packed, mcap_files.unpack(chunk)


def test_small_chunks_have_zstds_default(tmp_path):
    data = b"".join(number.to_bytes(4, "little") for number in range(50_000))
    packed, plain = packed_and_plain(tmp_path / "x.mcap", data)
    assert packed == zstandard.ZstdCompressor(level=3).compress(plain)


def test_sweeps_are_packed_smaller_than_by_a_quick_level(tmp_path):
    kinds = [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("intensity", "<f4"), ("time", "<f4"), ("ring", "<u2")]
    points = np.zeros((1000, 64), dtype=[*kinds, ("instance", "<u2")])
    angle_rad = np.linspace(-np.pi, np.pi, 1000)[:, None]
    range_m = 1.93 / np.tan(np.radians(np.linspace(4.0, 25.0, 64)))
    for name, value in (("x", range_m * np.cos(angle_rad)), ("y", range_m * np.sin(angle_rad))):
        points[name] = np.round(value * 128.0) / 128.0
    points["z"], points["ring"], points["time"] = -1.93, np.arange(64), angle_rad
    packed, plain = packed_and_plain(tmp_path / "x.mcap", points.tobytes())
    assert zstandard.ZstdDecompressor().decompress(packed) == plain
    assert len(packed) < 0.9 * len(zstandard.ZstdCompressor(level=-2).compress(plain))


def test_second_copies_are_a_file_of_their_own_with_the_definitions_that_they_need(tmp_path):
    with (tmp_path / "x.mcap").open("w+b", buffering=0) as file:
        stream = McapStream(file)
        stream.write_chunk(FIRST)
        stream.attach_copies([])
        stream.attach_copies(FIRST.messages[:1])
        stream.finish()
        file.seek(0)
        (place,) = (place for place in mcap_files.read_places(file) if place.opcode == Opcode.ATTACHMENT)
        (copies,) = mcap_files.read_copies(file, [place])
        assert copies == ChunkContent(SCHEMAS[1:], CHANNELS[1:2], FIRST.messages[:1])
    with (tmp_path / "x.mcap").open("rb") as opened:
        summary = SeekingReader(opened, validate_crcs=True).get_summary()
    (index,) = summary.attachment_indexes
    assert (index.offset, index.length, index.name) == (place.offset, place.length + 9, COPIES_NAME)
    data = bytearray((tmp_path / "x.mcap").read_bytes())
    data[place.offset + place.length // 2] ^= 1
    damaged = BytesIO(data)
    with pytest.raises(mcap_files.DamageError, match=f"attachment at byte {place.offset} does not have its checksum"):
        mcap_files.read_attachment(damaged, place)
    assert mcap_files.read_copies(damaged, [place]) == []
