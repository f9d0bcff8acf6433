"""Checks a bag's files before they are read, because a bag may come from an untrusted source.

It refuses files outside the folder, compressed files and databases, metadata with aliases, and chunks that claim or
unpack to more memory than a recorder writes.
"""

import struct
import zlib
from pathlib import Path
from typing import BinaryIO, Final

from mcap.opcode import Opcode
from mcap.reader import SeekingReader
from mcap.summary import Summary

from siren_ros.errors import BagError
from siren_ros.recording.bag_metadata import METADATA_FILE, read_metadata
from siren_ros.recording.mcap_scan import DamageError, read_attachment, read_chunk, read_places, unpack
from siren_ros.recording.mcap_stream import MAGIC

MAX_SUMMARY_BYTES: Final = 100_000_000
"""An index of a million messages has 30 MB."""
_FOOTER: Final = struct.Struct("<BQQQI8s")
"""Code, length, start of the summary, start of the offsets, checksum; then the magic bytes at the end of the file."""
_FOOTER_FIELDS_BYTES: Final = 20
_AFTER_CRC_BYTES: Final = 12


def storage_files(bag: Path) -> list[Path]:
    """The MCAP files in a bag's folder, in the order of their names."""
    return sorted(file for file in bag.glob("*.mcap") if file.is_file())


def check_bag_files(bag: Path, content: bool = False) -> None:
    """Refuses a bag whose files are damaged, misplaced or too large.

    Args:
        bag: Folder of the bag.
        content: Also unpack every chunk, compare its checksum and those of attachments, and read the summary.

    Raises:
        BagError: What is wrong, and where.
    """
    for name in _named_files(bag):
        file = bag / name
        if Path(name).name != name or file.suffix != ".mcap" or not file.is_file():
            raise BagError(str(bag), f"a bag whose files are .mcap files in its folder, unlike {name!r}")
        try:
            _check_storage(file, content)
        except DamageError as error:
            raise BagError(str(bag), f"an undamaged episode ({name}: {error})") from error
        except OSError as error:
            raise BagError(str(bag), f"a bag that can be read ({error.strerror or error})") from error


def _named_files(bag: Path) -> list[str]:
    information = read_metadata(bag)
    names = information.get("relative_file_paths")
    if information.get("compression_mode") or information.get("storage_identifier") != "mcap":
        raise BagError(str(bag), "a bag in MCAP storage, its file not compressed as a whole")
    if not isinstance(names, list) or not names or not all(isinstance(name, str) for name in names):
        raise BagError(str(bag), f"a bag whose {METADATA_FILE} names its files")
    return names


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
    """The summary of a file: definitions, statistics and the index of chunks.

    Args:
        stream: The file.
        size: Its length in bytes.

    Raises:
        DamageError: The file has no end, or its summary is damaged.
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
    """A reader begins at the footer. The footer must lead to an undamaged summary inside the file."""
    stream.seek(max(0, size - _FOOTER.size))
    end = stream.read()
    if len(end) < _FOOTER.size:
        raise DamageError("the file has no end")
    code, length, start, _, crc, magic = _FOOTER.unpack(end)
    if code != Opcode.FOOTER or length != _FOOTER_FIELDS_BYTES or magic != MAGIC or not 0 < start < size:
        raise DamageError("the file has no end")
    if size - start > MAX_SUMMARY_BYTES:
        raise DamageError(f"a summary of {size - start} bytes; {MAX_SUMMARY_BYTES} are allowed")
    stream.seek(start)
    if crc and zlib.crc32(stream.read(size - start - _AFTER_CRC_BYTES)) != crc:
        raise DamageError("the summary does not have its checksum")
