"""The folder of a bag that is being written: names, locks, reserve, and what is left where something goes wrong."""

from pathlib import Path

import pytest

from siren_ros.errors import BagError
from siren_ros.recording.working_folder import (
    RESERVE_BYTES,
    RESERVE_FILE,
    WorkingFolder,
    check_new_bag,
    free_partial_path,
    lock,
    working_path,
)

FILE = "bag_0.mcap"


def test_names_next_to_the_bag(tmp_path: Path) -> None:
    bag = tmp_path / "bag"
    assert working_path(bag) == tmp_path / ".bag.partial"
    assert free_partial_path(bag) == tmp_path / "bag.partial"
    (tmp_path / "bag.partial").mkdir()
    assert free_partial_path(bag) == tmp_path / "bag.partial-2"
    (tmp_path / "bag.partial-2").mkdir()
    (tmp_path / "bag.partial-3").mkdir()
    assert free_partial_path(bag) == tmp_path / "bag.partial-4"


def test_the_folder_and_those_above_it_are_made(tmp_path: Path) -> None:
    bag = tmp_path / "a" / "b" / "bag"
    folder = WorkingFolder(bag, FILE)
    assert (folder.path / RESERVE_FILE).stat().st_size == RESERVE_BYTES
    assert folder.is_there()
    assert not bag.exists()
    folder.file.write(b"content")
    folder.close("meta: 1\n")
    assert folder.move_to(bag) == bag
    assert sorted(path.name for path in bag.iterdir()) == [FILE, "metadata.yaml"]
    assert (bag / "metadata.yaml").read_text() == "meta: 1\n"
    assert (bag / FILE).read_bytes() == b"content"
    assert not folder.path.exists()


def test_a_removed_folder_takes_an_empty_parent_with_it(tmp_path: Path) -> None:
    folder = WorkingFolder(tmp_path / "a" / "bag", FILE)
    folder.remove()
    assert not (tmp_path / "a").exists()
    (tmp_path / "b").mkdir()
    (tmp_path / "b" / "other").touch()
    WorkingFolder(tmp_path / "b" / "bag", FILE).remove()
    assert [path.name for path in (tmp_path / "b").iterdir()] == ["other"]


def test_the_folder_of_a_killed_writer_is_set_aside(tmp_path: Path) -> None:
    bag = tmp_path / "bag"
    left = working_path(bag)
    left.mkdir()
    (left / FILE).write_bytes(b"left")
    folder = WorkingFolder(bag, FILE)
    assert (tmp_path / "bag.partial" / FILE).read_bytes() == b"left"
    assert (folder.path / FILE).stat().st_size == 0
    folder.remove()


def test_a_killed_writer_may_have_left_no_file(tmp_path: Path) -> None:
    bag = tmp_path / "bag"
    working_path(bag).mkdir()
    WorkingFolder(bag, FILE).remove()
    assert (tmp_path / "bag.partial").is_dir()


def test_a_running_writer_is_left_alone(tmp_path: Path) -> None:
    first = WorkingFolder(tmp_path / "bag", FILE)
    with pytest.raises(BagError, match="no other episode is writing"):
        WorkingFolder(tmp_path / "bag", FILE)
    assert first.is_there()
    assert not (tmp_path / "bag.partial").exists()
    with (first.path / FILE).open("rb", buffering=0) as other:
        assert not lock(other)
        first.close("")
        assert lock(other)


def test_another_file_under_the_same_path_is_not_the_open_one(tmp_path: Path) -> None:
    folder = WorkingFolder(tmp_path / "bag", FILE)
    folder.file.write(b"written")
    folder.check()
    (folder.path / FILE).unlink()
    (folder.path / FILE).write_bytes(b"somebody else's")
    assert not folder.is_there()
    with pytest.raises(FileNotFoundError, match="disappeared"):
        folder.check()
    folder.restore()
    assert (folder.path / FILE).read_bytes() == b"written"
    folder.remove()


def test_what_is_there_is_not_restored(tmp_path: Path) -> None:
    folder = WorkingFolder(tmp_path / "bag", FILE)
    folder.file.write(b"written")
    folder.restore()
    assert folder.file.tell() == len(b"written")
    folder.remove()


def test_an_existing_target_is_refused(tmp_path: Path) -> None:
    folder = WorkingFolder(tmp_path / "bag", FILE)
    (tmp_path / "bag").mkdir()
    folder.close("")
    with pytest.raises(FileExistsError):
        folder.move_to(tmp_path / "bag")
    assert folder.path.is_dir()
    with pytest.raises(BagError, match="new folder"):
        WorkingFolder(tmp_path / "bag", FILE)


def test_the_reserve_can_be_freed_twice(tmp_path: Path) -> None:
    folder = WorkingFolder(tmp_path / "bag", FILE)
    folder.free_reserve()
    assert not (folder.path / RESERVE_FILE).exists()
    folder.free_reserve()
    folder.remove()
    folder.remove()


def test_a_place_that_cannot_be_written_says_why(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(BagError, match=r"Not a directory|File exists"):
        WorkingFolder(tmp_path / "file" / "bag", FILE)


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
def test_a_path_that_could_not_be_taken_at_the_end_is_refused_at_the_start(
    tmp_path: Path, name: str, allowed: str
) -> None:
    (tmp_path / "file").touch()
    (tmp_path / "link").symlink_to(tmp_path / "nowhere" / "at all")
    for use in (check_new_bag, lambda bag: WorkingFolder(bag, FILE)):
        with pytest.raises(BagError) as refused:
            use(tmp_path / name)
        assert refused.value.allowed == allowed
    assert sorted(path.name for path in tmp_path.iterdir()) == ["file", "link"]


def test_unusual_names_are_names(tmp_path: Path) -> None:
    for name in ("a: b", "ä", "-p", "x" * 240):
        check_new_bag(tmp_path / name)
        folder = WorkingFolder(tmp_path / name, FILE)
        folder.close("")
        assert folder.move_to(tmp_path / name).is_dir()
