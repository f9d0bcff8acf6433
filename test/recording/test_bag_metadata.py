"""``metadata.yaml`` as rosbag2 reads it, and what is refused of a foreign one."""

from pathlib import Path

import pytest
import yaml

from siren_ros.errors import BagError
from siren_ros.recording.bag_metadata import (
    MAX_METADATA_BYTES,
    BagTopic,
    metadata_text,
    qos_profiles,
    qos_text,
    read_message_counts,
    read_metadata,
)

TOPICS = (BagTopic("/a", "a/A", "RIHS01_1", True, 1), BagTopic("/b", "b/B", "RIHS01_2", False, 41))


def test_spans_and_counts() -> None:
    found = yaml.safe_load(metadata_text("x_0.mcap", TOPICS, 2_000, 7_500, {"z": "1", "a": "2"}))
    information = found["rosbag2_bagfile_information"]
    assert information["version"] == 9
    assert information["duration"] == {"nanoseconds": 5_500}
    assert information["starting_time"] == {"nanoseconds_since_epoch": 2_000}
    assert information["message_count"] == 42
    assert information["relative_file_paths"] == ["x_0.mcap"]
    (file,) = information["files"]
    assert file == {
        "path": "x_0.mcap",
        "starting_time": {"nanoseconds_since_epoch": 2_000},
        "duration": {"nanoseconds": 5_500},
        "message_count": 42,
    }
    assert list(information["custom_data"]) == ["a", "z"]
    first, second = information["topics_with_message_count"]
    assert (first["message_count"], second["message_count"]) == (1, 41)
    assert first["topic_metadata"]["type_description_hash"] == "RIHS01_1"
    assert first["topic_metadata"]["offered_qos_profiles"] == qos_profiles(True)
    assert second["topic_metadata"]["offered_qos_profiles"] == qos_profiles(False)


def test_no_custom_data_is_none() -> None:
    assert yaml.safe_load(metadata_text("x", (), 0, 0, {}))["rosbag2_bagfile_information"]["custom_data"] is None


def test_latched_topics_keep_their_last_message() -> None:
    (latched,), (plain,) = qos_profiles(True), qos_profiles(False)
    assert (latched["durability"], latched["depth"]) == ("transient_local", 1)
    assert (plain["durability"], plain["depth"]) == ("volatile", 10)
    assert latched["deadline"] == {"sec": 9223372036, "nsec": 854775807}
    assert latched["avoid_ros_namespace_conventions"] is False
    assert yaml.safe_load(qos_text(True)) == [latched]
    assert "&" not in qos_text(False), "no YAML anchors"
    assert qos_text(True) == qos_text(True).strip()


def write(folder: Path, text: str) -> Path:
    folder.mkdir(exist_ok=True)
    (folder / "metadata.yaml").write_text(text, encoding="utf-8")
    return folder


def test_counts_are_read_back(tmp_path: Path) -> None:
    bag = write(tmp_path / "bag", metadata_text("x_0.mcap", TOPICS, 0, 1, {}))
    assert read_message_counts(bag) == {"/a": 1, "/b": 41}


@pytest.mark.parametrize(
    "text",
    [
        "",
        "[1]",
        "rosbag2_bagfile_information: 3",
        "rosbag2_bagfile_information: [1]",
        "other: {}",
        "a: [",
        "a: &x 1\nb: *x",
    ],
)
def test_what_is_no_metadata(tmp_path: Path, text: str) -> None:
    with pytest.raises(BagError, match="readable metadata"):
        read_metadata(write(tmp_path / "bag", text))
    with pytest.raises(BagError, match="metadata"):
        read_metadata(tmp_path / "missing")


def test_metadata_of_a_megabyte_is_too_large(tmp_path: Path) -> None:
    head = "rosbag2_bagfile_information: {a: 1}\n#"
    read_metadata(write(tmp_path / "bag", head + "x" * (MAX_METADATA_BYTES - len(head))))
    with pytest.raises(BagError, match="at most 1000000 bytes"):
        read_metadata(write(tmp_path / "bag", head + "x" * (MAX_METADATA_BYTES - len(head) + 1)))


@pytest.mark.parametrize(
    "topics", ["3", "[{}]", "[{topic_metadata: {name: /a}}]", "[{topic_metadata: {name: /a}, message_count: x}]"]
)
def test_counts_that_cannot_be_read(tmp_path: Path, topics: str) -> None:
    text = f"rosbag2_bagfile_information: {{topics_with_message_count: {topics}}}"
    with pytest.raises(BagError, match="readable metadata"):
        read_message_counts(write(tmp_path / "bag", text))
