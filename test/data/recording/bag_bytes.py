"""The bytes of a bag's file: its chunks, and changes to them."""

from collections.abc import Callable
from pathlib import Path

from siren_ros.data.recording.mcap_files import PackedChunk, read_chunks


def chunks_of(file: Path) -> list[PackedChunk]:
    with file.open("rb") as stream:
        return list(read_chunks(stream))


def rewrite(bag: Path, change: Callable[[bytearray], object]) -> None:
    """Changes the bytes of a bag's file in place."""
    (file,) = bag.glob("*.mcap")
    data = bytearray(file.read_bytes())
    change(data)
    file.write_bytes(data)


def flip_bit(data: bytearray, place: int, bit: int = 0x10) -> None:
    data[place] ^= bit
