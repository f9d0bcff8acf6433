"""Records of an MCAP file one after the other: to the last whole one, and no further."""

import struct
from itertools import pairwise
from pathlib import Path

import pytest
import zstandard
from mcap.opcode import Opcode

from siren_ros.data.recording import mcap_scan
from siren_ros.data.recording.mcap_stream import ChannelMessage, ChunkContent, McapStream

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


def places_of(path: Path, length: int | None = None) -> tuple[list[mcap_scan.RecordPlace], str]:
    """The records of the first bytes of a file, and why there are no more."""
    read: list[mcap_scan.RecordPlace] = []
    cut = path.with_name("cut.mcap")
    cut.write_bytes(path.read_bytes()[:length])
    with cut.open("rb") as file:
        places = mcap_scan.read_places(file)
        try:
            while (place := next(places, None)) is not None:
                read.append(place)
        except mcap_scan.DamageError as error:
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


@pytest.mark.parametrize("number", [1, 2, 3, 4])
def test_a_file_that_ends_right_behind_a_record_has_that_record(whole, number):
    """A writer that is killed between two records leaves such a file."""
    whole_places, _ = places_of(whole)
    last = whole_places[number]
    places, why = places_of(whole, last.offset + 9 + last.length)
    assert places == whole_places[: number + 1]
    assert "ends at byte" in why


@pytest.mark.parametrize("missing", [1, 9])
def test_a_record_that_was_cut_off_is_none(whole, missing):
    whole_places, _ = places_of(whole)
    last = whole_places[3]
    places, why = places_of(whole, last.offset + 9 + last.length - missing)
    assert places == whole_places[:3]
    assert f"no whole record of a bag with chunks at byte {last.offset}" in why


def test_chunks_are_read_back(whole):
    with whole.open("rb") as file:
        assert [mcap_scan.parse_content(mcap_scan.unpack(chunk)) for chunk in mcap_scan.read_chunks(file)] == [
            CONTENT,
            CONTENT,
        ]
    places, _ = places_of(whole)
    with whole.open("rb") as file:
        chunk = mcap_scan.read_chunk(file, places[1])
    assert (chunk.offset, chunk.compression) == (places[1].offset, "zstd")


def test_what_does_not_begin_like_a_bag_is_none(tmp_path):
    path = tmp_path / "x"
    path.write_bytes(b"PK\x03\x04" * 20)
    with path.open("rb") as file, pytest.raises(mcap_scan.DamageError):
        list(mcap_scan.read_places(file))


def packed_chunk(packed: bytes, plain_bytes: int, compression: bytes = b"zstd") -> bytes:
    """The content of a chunk's record (MCAP's specification): times, size, checksum, compression, length, data."""
    head = struct.pack("<QQQI", 0, 0, plain_bytes, 0)
    return head + struct.pack("<I", len(compression)) + compression + struct.pack("<Q", len(packed)) + packed


@pytest.mark.parametrize("checksum", [False, True])
@pytest.mark.parametrize("plain", [b"", b"x", b"abc" * 1000, bytes(300_000)])
def test_frames_of_any_length_are_measured(plain, checksum):
    """The frame of nothing ends with the head of its one block."""
    packed = zstandard.ZstdCompressor(write_checksum=checksum).compress(plain)
    chunk = mcap_scan._chunk(packed_chunk(packed, len(plain)), 7)
    assert (chunk.offset, chunk.compression, chunk.packed) == (7, "zstd", packed)
    if plain:
        assert mcap_scan.unpack(chunk) == plain


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
    with pytest.raises(mcap_scan.DamageError, match=reason):
        mcap_scan._chunk(packed_chunk(packed(frame), 3000), 7)


def frame_of_repeated_bytes(claimed: int, blocks: list[int]) -> bytes:
    """A zstd frame (RFC 8878, section 3.1.1) that claims a size and repeats one byte so often in each block."""
    head = (0xFD2FB528).to_bytes(4, "little") + bytes([0b1010_0000]) + claimed.to_bytes(4, "little")
    heads = [(length << 3 | 1 << 1 | (number == len(blocks) - 1)) for number, length in enumerate(blocks)]
    return head + b"".join(block.to_bytes(3, "little") + b"x" for block in heads)


@pytest.mark.parametrize("claimed", [3000, mcap_scan.MAX_CHUNK_BYTES])
@pytest.mark.parametrize("over", [0, 1])
def test_a_small_chunk_that_unpacks_to_more_than_is_allowed_is_refused_unread(claimed, over):
    """Some 16 kB of blocks whose bytes are twice what a chunk may have; the frame's own claim is harmless."""
    block_bytes = 1 << 17
    blocks = [block_bytes] * (2 * mcap_scan.MAX_CHUNK_BYTES // block_bytes) + [
        2 * mcap_scan.MAX_CHUNK_BYTES % block_bytes + over
    ]
    content = packed_chunk(frame_of_repeated_bytes(claimed, blocks), claimed)
    assert len(content) < 20_000
    if over:
        with pytest.raises(
            mcap_scan.DamageError, match=f"more than one frame of at most {mcap_scan.MAX_CHUNK_BYTES} bytes"
        ):
            mcap_scan._chunk(content, 7)
    else:
        assert mcap_scan._chunk(content, 7).plain_bytes == claimed


def test_a_frame_of_repeated_bytes_is_read():
    frame = frame_of_repeated_bytes(300_000, [131_072, 131_072, 37_856])
    assert mcap_scan.unpack(mcap_scan._chunk(packed_chunk(frame, 300_000), 7)) == b"x" * 300_000


@pytest.mark.parametrize("off", [-1, 1])
def test_a_size_that_is_not_the_contents_is_refused(off):
    frame = zstandard.ZstdCompressor().compress(b"abc" * 1000)
    with pytest.raises(mcap_scan.DamageError, match=f"claims {3000 + off} bytes and holds 3000"):
        mcap_scan._chunk(packed_chunk(frame, 3000 + off), 7)
    with pytest.raises(mcap_scan.DamageError, match=f"claims {4 + off} bytes and holds 4"):
        mcap_scan._chunk(packed_chunk(b"abcd", 4 + off, b""), 7)
    assert mcap_scan._chunk(packed_chunk(b"abcd", 4, b""), 7).packed == b"abcd"


@pytest.mark.parametrize("change", [-1, 1])
def test_lengths_that_contradict_each_other_are_refused(change):
    content = packed_chunk(b"abcd", 4, b"")
    longer = content[:-12] + struct.pack("<Q", 4 + change) + content[-4:]
    for broken in (longer, content[:-1], content + b"x"):
        with pytest.raises(mcap_scan.DamageError, match="contradict"):
            mcap_scan._chunk(broken, 7)


def test_other_compressions_are_refused():
    with pytest.raises(mcap_scan.DamageError, match="'lz4'; zstd and none"):
        mcap_scan._chunk(packed_chunk(b"abcd", 4, b"lz4"), 7)
