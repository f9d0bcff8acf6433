"""``metadata.yaml`` as rosbag2 reads it, and the folder of a bag that is being written."""

from pathlib import Path

import pytest
import yaml

from siren_ros.data.recording import bag_folder
from siren_ros.errors import BagError

TOPICS = (
    bag_folder.BagTopic("/a", "a/A", "RIHS01_1", True, 1),
    bag_folder.BagTopic("/b", "b/B", "RIHS01_2", False, 41),
)
FILE = "bag_0.mcap"


def test_spans_and_counts():
    content = yaml.safe_load(bag_folder.metadata_text("x_0.mcap", TOPICS, 2_000, 7_500, {"z": "1", "a": "2"}))
    information = content["rosbag2_bagfile_information"]
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
    assert first["topic_metadata"]["offered_qos_profiles"] == bag_folder.qos_profiles(True)
    assert second["topic_metadata"]["offered_qos_profiles"] == bag_folder.qos_profiles(False)
    plain = yaml.safe_load(bag_folder.metadata_text("x", (), 0, 0, {}))
    assert plain["rosbag2_bagfile_information"]["custom_data"] is None


def test_latched_topics_keep_their_last_message():
    (latched,), (plain,) = bag_folder.qos_profiles(True), bag_folder.qos_profiles(False)
    assert (latched["durability"], latched["depth"]) == ("transient_local", 1)
    assert (plain["durability"], plain["depth"]) == ("volatile", 10)
    assert latched["deadline"] == {"sec": 9223372036, "nsec": 854775807}
    assert latched["avoid_ros_namespace_conventions"] is False
    assert yaml.safe_load(bag_folder.qos_text(True)) == [latched]
    assert "&" not in bag_folder.qos_text(False), "no YAML anchors"
    assert bag_folder.qos_text(True) == bag_folder.qos_text(True).strip()


def write(folder: Path, text: str) -> Path:
    folder.mkdir(exist_ok=True)
    (folder / "metadata.yaml").write_text(text, encoding="utf-8")
    return folder


def test_counts_are_read_back(tmp_path):
    bag = write(tmp_path / "bag", bag_folder.metadata_text("x_0.mcap", TOPICS, 0, 1, {}))
    assert bag_folder.read_message_counts(bag) == {"/a": 1, "/b": 41}


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
        "[" * 5000,
        "rosbag2_bagfile_information: !!python/object/apply:os.system ['true']\n",
    ],
)
def test_what_is_no_metadata(tmp_path, text):
    with pytest.raises(BagError, match="readable metadata"):
        bag_folder.read_metadata(write(tmp_path / "bag", text))
    with pytest.raises(BagError, match="metadata"):
        bag_folder.read_metadata(tmp_path / "missing")


def test_metadata_of_a_megabyte_is_too_large(tmp_path):
    head = "rosbag2_bagfile_information: {a: 1}\n#"
    bag_folder.read_metadata(write(tmp_path / "bag", head + "x" * (bag_folder.MAX_METADATA_BYTES - len(head))))
    with pytest.raises(BagError, match="at most 1000000 bytes"):
        bag_folder.read_metadata(write(tmp_path / "bag", head + "x" * (bag_folder.MAX_METADATA_BYTES - len(head) + 1)))


@pytest.mark.parametrize(
    "topics", ["3", "[{}]", "[{topic_metadata: {name: /a}}]", "[{topic_metadata: {name: /a}, message_count: x}]"]
)
def test_counts_that_cannot_be_read(tmp_path, topics):
    text = f"rosbag2_bagfile_information: {{topics_with_message_count: {topics}}}"
    with pytest.raises(BagError, match="readable metadata"):
        bag_folder.read_message_counts(write(tmp_path / "bag", text))


def test_names_next_to_the_bag(tmp_path):
    bag = tmp_path / "bag"
    assert bag_folder.working_path(bag) == tmp_path / ".bag.partial"
    assert bag_folder.free_partial_path(bag) == tmp_path / "bag.partial"
    (tmp_path / "bag.partial").mkdir()
    assert bag_folder.free_partial_path(bag) == tmp_path / "bag.partial-2"
    (tmp_path / "bag.partial-2").mkdir()
    (tmp_path / "bag.partial-3").mkdir()
    assert bag_folder.free_partial_path(bag) == tmp_path / "bag.partial-4"


def test_the_folder_and_those_above_it_are_made(tmp_path):
    bag = tmp_path / "a" / "b" / "bag"
    folder = bag_folder.WorkingFolder(bag, FILE)
    assert (folder.path / bag_folder.RESERVE_FILE).stat().st_size == bag_folder.RESERVE_BYTES
    assert folder.is_there()
    assert not bag.exists()
    folder.file.write(b"content")
    folder.close("meta: 1\n")
    assert folder.move_to(bag) == bag
    assert sorted(path.name for path in bag.iterdir()) == [FILE, "metadata.yaml"]
    assert (bag / "metadata.yaml").read_text() == "meta: 1\n"
    assert (bag / FILE).read_bytes() == b"content"
    assert not folder.path.exists()


def test_a_removed_folder_takes_an_empty_parent_with_it(tmp_path):
    folder = bag_folder.WorkingFolder(tmp_path / "a" / "bag", FILE)
    for _twice in range(2):
        folder.free_reserve()
        assert not (folder.path / bag_folder.RESERVE_FILE).exists()
    for _twice in range(2):
        folder.remove()
    assert not (tmp_path / "a").exists()
    (tmp_path / "b").mkdir()
    (tmp_path / "b" / "other").touch()
    bag_folder.WorkingFolder(tmp_path / "b" / "bag", FILE).remove()
    assert [path.name for path in (tmp_path / "b").iterdir()] == ["other"]


def test_the_folder_of_a_killed_writer_is_set_aside(tmp_path):
    """It may have left no file."""
    bag = tmp_path / "bag"
    left = bag_folder.working_path(bag)
    for name, content in (("bag.partial", b"left"), ("bag.partial-2", None)):
        left.mkdir()
        if content:
            (left / FILE).write_bytes(content)
        folder = bag_folder.WorkingFolder(bag, FILE)
        assert [path.read_bytes() for path in (tmp_path / name).iterdir()] == ([content] if content else [])
        assert (folder.path / FILE).stat().st_size == 0
        folder.remove()


def test_a_running_writer_is_left_alone(tmp_path):
    first = bag_folder.WorkingFolder(tmp_path / "bag", FILE)
    with pytest.raises(BagError, match="no other episode is writing"):
        bag_folder.WorkingFolder(tmp_path / "bag", FILE)
    assert first.is_there()
    assert [path.name for path in tmp_path.iterdir()] == [".bag.partial"]
    first.close("")
    with (first.path / FILE).open("rb", buffering=0) as other:
        assert bag_folder.lock(other)


def test_another_file_under_the_same_path_is_not_the_open_one(tmp_path):
    folder = bag_folder.WorkingFolder(tmp_path / "bag", FILE)
    folder.file.write(b"written")
    folder.check()
    folder.restore()
    assert folder.file.tell() == len(b"written"), "what is there is not restored"
    (folder.path / FILE).unlink()
    (folder.path / FILE).write_bytes(b"somebody else's")
    assert not folder.is_there()
    with pytest.raises(FileNotFoundError, match="disappeared"):
        folder.check()
    folder.restore()
    assert (folder.path / FILE).read_bytes() == b"written"
    folder.remove()


def test_an_existing_target_is_refused(tmp_path):
    folder = bag_folder.WorkingFolder(tmp_path / "bag", FILE)
    (tmp_path / "bag").mkdir()
    folder.close("")
    with pytest.raises(FileExistsError):
        folder.move_to(tmp_path / "bag")
    assert folder.path.is_dir()
    with pytest.raises(BagError, match="new folder"):
        bag_folder.WorkingFolder(tmp_path / "bag", FILE)


@pytest.mark.parametrize(
    ("name", "allowed"),
    [
        ("x" * 300, "a place that can be written (File name too long)"),
        ("x" * 250, "a place that can be written (File name too long)"),
        ("b\udcff", "a path in UTF-8"),
        ("a\0b", "a place that can be written (embedded null byte)"),
        ("link", "the path of a new folder; a link that leads nowhere is there"),
        ("file", "the path of a new folder; this one exists already"),
        ("file/bag", "a place that can be written (Not a directory)"),
    ],
    ids=["300 characters", "longer while it grows", "bytes", "null", "dangling link", "file", "below a file"],
)
def test_a_path_that_could_not_be_taken_at_the_end_is_refused_at_the_start(tmp_path, name, allowed):
    (tmp_path / "file").touch()
    (tmp_path / "link").symlink_to(tmp_path / "nowhere" / "at all")
    for use in (bag_folder.check_new_bag, lambda bag: bag_folder.WorkingFolder(bag, FILE)):
        with pytest.raises(BagError) as refused:
            use(tmp_path / name)
        assert refused.value.allowed == allowed
    assert sorted(path.name for path in tmp_path.iterdir()) == ["file", "link"]


def test_unusual_names_are_names(tmp_path):
    for name in ("a: b", "ä", "-p", "x" * 240):
        bag_folder.check_new_bag(tmp_path / name)
        folder = bag_folder.WorkingFolder(tmp_path / name, FILE)
        folder.close("")
        assert folder.move_to(tmp_path / name).is_dir()
