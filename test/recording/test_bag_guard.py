"""What is checked of a bag's files before they are read: always its form, on request every byte."""

from collections.abc import Callable
from pathlib import Path

import pytest
import yaml
from mcap.reader import make_reader

from siren_ros.errors import BagError
from siren_ros.recording.bag_guard import check_bag_files, storage_files
from siren_ros.recording.bag_metadata import METADATA_FILE
from siren_ros.recording.mcap_scan import read_chunks


@pytest.fixture
def bag(tmp_path: Path, write_bag: Callable[..., Path]) -> Path:
    return write_bag(tmp_path / "bag", duration_s=1.0)


def test_a_flipped_bit_is_found_where_the_content_is_asked_for(bag: Path) -> None:
    check_bag_files(bag, content=True)
    (file,) = storage_files(bag)
    with file.open("rb") as stream:
        chunk = next(iter(read_chunks(stream)))
    data = bytearray(file.read_bytes())
    data[chunk.offset + 200] ^= 1
    file.write_bytes(bytes(data))
    check_bag_files(bag)
    with pytest.raises(BagError, match="undamaged"):
        check_bag_files(bag, content=True)


def test_a_summary_is_held_against_its_checksum(bag: Path) -> None:
    (file,) = storage_files(bag)
    data = bytearray(file.read_bytes())
    data[-60] ^= 1
    file.write_bytes(bytes(data))
    with pytest.raises(BagError, match="summary does not have its checksum"):
        check_bag_files(bag)


def change(bag: Path, **values: object) -> None:
    path = bag / METADATA_FILE
    content = yaml.safe_load(path.read_text())
    content["rosbag2_bagfile_information"].update(values)
    path.write_text(yaml.safe_dump(content))


@pytest.mark.parametrize(
    ("values", "reason"),
    [
        ({"relative_file_paths": ["../bag_0.mcap"]}, "in its folder"),
        ({"relative_file_paths": ["other.mcap"]}, "in its folder"),
        ({"relative_file_paths": ["metadata.yaml"]}, "in its folder"),
        ({"relative_file_paths": []}, "names its files"),
        ({"relative_file_paths": [3]}, "names its files"),
        ({"relative_file_paths": "bag_0.mcap"}, "names its files"),
        ({"compression_mode": "file"}, "not compressed as a whole"),
        ({"storage_identifier": "sqlite3"}, "MCAP storage"),
    ],
)
def test_metadata_that_leads_elsewhere_is_refused(bag: Path, values: dict[str, object], reason: str) -> None:
    change(bag, **values)
    with pytest.raises(BagError, match=reason):
        check_bag_files(bag)


def test_a_file_without_an_end_is_refused(bag: Path) -> None:
    (file,) = storage_files(bag)
    file.write_bytes(file.read_bytes()[:-1])
    with pytest.raises(BagError, match="the file has no end"):
        check_bag_files(bag)


@pytest.mark.parametrize(
    ("at", "byte"), [(0, 0x03), (1, 21), (9, 0), (36, 0x00)], ids=["another record", "its length", "start", "magic"]
)
def test_every_part_of_the_end_counts(bag: Path, at: int, byte: int) -> None:
    """Opcode, length, start of the summary (here: made 0), of its offsets, checksum and magic: 37 bytes."""
    (file,) = storage_files(bag)
    data = bytearray(file.read_bytes())
    end = len(data) - 37
    assert data[end] == 0x02
    if at == 9:
        data[end + 9 : end + 17] = bytes(8)
    data[end + at] = byte
    file.write_bytes(bytes(data))
    with pytest.raises(BagError, match="the file has no end"):
        check_bag_files(bag)


def test_definitions_are_those_of_ros_2(bag: Path) -> None:
    """In ROS 1 times are built in, and the definition of a message names no package for them."""
    (file,) = storage_files(bag)
    with file.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    texts = [schema.data.decode() for schema in summary.schemas.values()]
    assert any("builtin_interfaces/Time clock" in text for text in texts)
    assert not any(line.startswith("time ") for text in texts for line in text.splitlines())


def test_storage_files_are_files_in_the_order_of_their_names(tmp_path: Path) -> None:
    for name in ("b_1.mcap", "b_0.mcap", "notes.txt"):
        (tmp_path / name).touch()
    (tmp_path / "folder.mcap").mkdir()
    assert [path.name for path in storage_files(tmp_path)] == ["b_0.mcap", "b_1.mcap"]
