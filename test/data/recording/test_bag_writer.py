"""The writer of bags and its thread: order, bytes, chunks, and what is left where something goes wrong."""

import errno
import os
import shutil
import signal
import struct
import subprocess
import sys
import textwrap
import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from io import BytesIO, FileIO
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest
import yaml
from mcap.exceptions import McapError
from mcap.reader import make_reader
from mcap.stream_reader import StreamReader
from rosbags.highlevel import AnyReader
from rosbags.typesys.store import Typestore

from siren_ros.data.interfaces.messages import make_message, stamp
from siren_ros.data.recording import bag_writer
from siren_ros.data.recording.bag_folder import WorkingFolder
from siren_ros.data.recording.bag_reader import open_bag
from siren_ros.data.recording.bag_writer import BackgroundWorker, BagOptions, BagSummary, EpisodeBagWriter
from siren_ros.data.recording.mcap_files import (
    ChunkContent,
    DamageError,
    McapStream,
    parse_content,
    plain_bytes,
    read_chunks,
    unpack,
)
from siren_ros.errors import EpisodeError

CLOCK = ("/clock", "rosgraph_msgs/msg/Clock")
TEXT = ("/siren/map", "std_msgs/msg/String")


def test_the_first_error_is_raised_and_what_comes_after_it_is_dropped():
    done: list[int] = []
    gate = threading.Event()

    def work(item: int) -> None:
        gate.wait(10.0)
        if item in {1, 2}:
            raise ValueError(item)
        done.append(item)

    worker = BackgroundWorker(work, 8, "own")
    for number in range(4):
        worker.put(number)
    gate.set()
    with pytest.raises(ValueError, match="1"):
        worker.close()
    assert done == [0]
    with pytest.raises(ValueError, match="1"):
        worker.put(5)


def test_a_full_queue_makes_the_caller_wait():
    """One item is under way and two wait: the fourth is not taken until there is space."""
    gate, taken, done = threading.Event(), [], []

    def work(item: int) -> None:
        gate.wait(10.0)
        done.append((item, threading.current_thread().name))

    worker = BackgroundWorker(work, 2, "own")

    def fill() -> None:
        for number in range(4):
            worker.put(number)
            taken.append(number)

    caller = threading.Thread(target=fill)
    caller.start()
    caller.join(0.3)
    assert caller.is_alive()
    assert len(taken) <= 3
    gate.set()
    caller.join(10.0)
    worker.close()
    assert taken == [0, 1, 2, 3]
    assert done == [(number, "own") for number in range(4)], "in order and in another thread"
    worker.close()


class Writing:
    """Writes the bag ``bag`` of a folder: a latched text, and clocks at steps."""

    def __init__(self, folder: Path, store: Typestore) -> None:
        self.folder, self.store = folder, store
        self.clock = bytes(store.serialize_cdr(make_message(CLOCK[1], clock=stamp(50_000_000)), CLOCK[1]))
        self.text = bytes(store.serialize_cdr(make_message(TEXT[1], data="<net/>"), TEXT[1]))

    def begin(self, steps: Iterable[int] = (0,), text: bool = False, **options: int) -> EpisodeBagWriter:
        writer = EpisodeBagWriter(self.folder / "bag", self.store, latched=[TEXT[0]], options=BagOptions(**options))
        if text:
            writer.write(*TEXT, self.text, 0)
        self.write_clocks(writer, steps)
        return writer

    def write_clocks(self, writer: EpisodeBagWriter, steps: Iterable[int]) -> None:
        for step in steps:
            writer.write(*CLOCK, self.clock, step * 50_000_000)

    def names(self) -> list[str]:
        return sorted(path.name for path in self.folder.iterdir())


@pytest.fixture
def writing(tmp_path: Path, typestore: Typestore) -> Writing:
    return Writing(tmp_path, typestore)


def contents(bag: Path) -> Iterator[ChunkContent]:
    """The contents of a bag's chunks, as far as they are undamaged."""
    with next(bag.glob("*.mcap")).open("rb") as file, suppress(DamageError):
        yield from (parse_content(unpack(chunk)) for chunk in read_chunks(file))


def message_sizes(bag: Path) -> list[list[int]]:
    """Sizes of the messages of each chunk."""
    return [[len(message.data) for message in content.messages] for content in contents(bag)]


def information(summary: BagSummary) -> dict[str, Any]:
    text = (summary.path / "metadata.yaml").read_text(encoding="utf-8")
    return dict(yaml.safe_load(text)["rosbag2_bagfile_information"])


def test_same_messages_give_the_same_bytes(tmp_path, write_bag):
    first, second = (write_bag(tmp_path / folder / "S2_L2_seed0", duration_s=3.0, lidar=True) for folder in ("a", "b"))
    names = sorted(path.name for path in first.iterdir())
    assert names == ["S2_L2_seed0_0.mcap", "metadata.yaml"]
    for name in names:
        assert (first / name).read_bytes() == (second / name).read_bytes()


def test_sequence_numbers_count_each_topics_messages(tmp_path, write_bag):
    sequences: dict[int, list[int]] = {}
    for content in contents(write_bag(tmp_path / "bag", duration_s=2.0)):
        for message in content.messages:
            sequences.setdefault(message.channel_id, []).append(message.sequence)
    assert len(sequences) > 5
    assert all(numbers == list(range(len(numbers))) for numbers in sequences.values())


def test_summary_and_metadata_give_sizes_counts_times_and_qualities(writing):
    summary = writing.begin(range(3, 11), text=True, chunk_bytes=1).finish()
    assert summary.message_counts == {TEXT[0]: 1, CLOCK[0]: 8}
    assert summary.size_bytes == sum(file.stat().st_size for file in summary.path.iterdir())
    metadata = information(summary)
    assert (metadata["version"], metadata["storage_identifier"], metadata["message_count"]) == (9, "mcap", 9)
    text, clock = (topic["topic_metadata"] for topic in metadata["topics_with_message_count"])
    assert text["type_description_hash"].startswith("RIHS01_")
    durabilities = [topic["offered_qos_profiles"][0]["durability"] for topic in (text, clock)]
    assert durabilities == ["transient_local", "volatile"]
    assert metadata["starting_time"]["nanoseconds_since_epoch"] == 0
    assert metadata["duration"]["nanoseconds"] == 500_000_000


def test_nothing_stands_under_the_final_name_before_the_end(writing):
    writer = writing.begin()
    assert writing.names() == [".bag.partial"]
    reserve = writing.folder / ".bag.partial" / ".reserve"
    assert reserve.stat().st_size == 1_000_000, "reserved for the end of the bag, and freed with it"
    summary = writer.finish()
    assert not (summary.path / ".reserve").exists()
    assert writing.names() == ["bag"]
    assert writer.abandon("late").path == summary.path, "abandoning a finished bag changes nothing"
    assert writing.names() == ["bag"]


def test_an_abandoned_bag_is_readable_and_says_why(writing):
    for name in ("bag.partial", "bag.partial-2"):
        summary = writing.begin().abandon("sensor_sim did not answer")
        assert summary.path.name == name
        with AnyReader([summary.path]) as reader:
            assert reader.message_count == 1
        custom = information(summary)["custom_data"]
        assert custom == {"siren_end": "partial", "siren_reason": "sensor_sim did not answer"}
    assert not (writing.folder / "bag").exists()


class FillingDisk:
    """A storage file on a disk that fills up: one write is taken in half, and the next ones are refused until freed."""

    def __init__(self) -> None:
        self.file: Any = None
        self.room_bytes = 1_000_000

    def stream(self, file: Any) -> McapStream:
        """What writes a bag: to this disk."""
        self.file = file
        return McapStream(cast("FileIO", self))

    def frees(self, room_bytes: int) -> Callable[[WorkingFolder], None]:
        """What gives the reserve of a bag's folder back: there is so much room then."""
        return lambda _folder: setattr(self, "room_bytes", room_bytes)

    def write(self, data: Any) -> int:
        if self.room_bytes <= 0:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        taken = int(self.file.write(data[: self.room_bytes]))
        self.room_bytes -= taken
        return taken

    def truncate(self, size: int) -> int:
        before = self.file.seek(0, os.SEEK_END)
        self.room_bytes += max(0, before - size)
        return int(self.file.truncate(size))

    def __getattr__(self, name: str) -> Any:
        return getattr(self.file, name)


@pytest.fixture
def disk(monkeypatch) -> FillingDisk:
    """The disk of all bags."""
    disk = FillingDisk()
    monkeypatch.setattr(bag_writer, "McapStream", disk.stream)
    return disk


def test_a_chunk_that_the_disk_took_in_part_is_taken_back(writing, disk, monkeypatch):
    writer = writing.begin((), chunk_bytes=64)
    disk.room_bytes = 20_000
    with pytest.raises(EpisodeError, match="disk is full"):
        writing.write_clocks(writer, range(5000))
    for _twice in range(2):
        with suppress(EpisodeError):
            writer.write(*TEXT, writing.text, 10**12)
    monkeypatch.setattr(WorkingFolder, "free_reserve", disk.frees(1_000_000))
    summary = writer.abandon("the disk is full")
    with open_bag(summary.path) as bag:
        times = [message.time_ns for message in bag.messages()]
    assert summary.message_counts == {CLOCK[0]: len(times)}, "the text was refused"
    assert len(times) > 20
    assert times == [step * 50_000_000 for step in range(len(times))]
    assert sum(len(content.messages) for content in contents(summary.path)) == len(times)


@pytest.mark.parametrize("written", [0, 10])
def test_a_folder_that_disappears_is_noticed_and_its_bag_is_saved(writing, written):
    writer = writing.begin(range(written), chunk_bytes=64)
    shutil.rmtree(writing.folder / ".bag.partial")
    with pytest.raises(EpisodeError, match="folder has disappeared"):
        writing.write_clocks(writer, [written])
    if written:
        with pytest.raises(EpisodeError, match="folder has disappeared"):
            writer.finish()
    summary = writer.abandon("the folder is gone")
    if written:
        with AnyReader([summary.path]) as reader:
            assert reader.message_count == written


def test_the_chunk_after_new_definitions_and_every_64th_repeat_all_definitions(writing):
    bag = writing.begin(range(1, 140), text=True, chunk_bytes=1).finish().path
    defined = [(len(content.schemas), len(content.channels), len(content.messages)) for content in contents(bag)]
    assert defined[0] == (1, 1, 1)
    # The second defines the clock, next to the repeated text.
    assert [number for number, (schemas, _, _) in enumerate(defined) if schemas == 2] == [1, 2, 64, 128]
    assert all(row in {(0, 0, 1), (2, 2, 1)} for row in defined[1:])


def test_a_chunk_has_at_most_64_kb_and_a_larger_message_is_a_chunk_of_its_own(writing):
    writer = writing.begin(())
    for step in range(60):
        for number, size in enumerate((15_000, 200_000 if step % 10 == 5 else 3_000, 400)):
            writer.write(f"/data{number}", "std_msgs/msg/String", bytes(size), step * 10_000_000)
    bag = writer.finish().path
    plain = [(len(plain_bytes(content)), [len(item.data) for item in content.messages]) for content in contents(bag)]
    assert [sizes for size, sizes in plain if size > 64_000] == [[200_000]] * 6
    together = [size for size, sizes in plain if 200_000 not in sizes]
    assert max(together) > 50_000
    assert len(together) < 40


def test_latched_messages_have_chunks_of_their_own_and_others_are_closed_after_a_second(writing):
    writer = EpisodeBagWriter(writing.folder / "bag", writing.store, latched=["/a", "/b", "/end"])
    for topic in ("/a", "/b"):
        writer.write(topic, TEXT[1], writing.text, 0)
    writing.write_clocks(writer, range(41))
    writer.write("/end", TEXT[1], writing.text, 2_000_000_000)
    text, clock = len(writing.text), len(writing.clock)
    assert message_sizes(writer.finish().path) == [[text, text], [clock] * 21, [clock] * 20, [text]]


def test_latched_messages_stand_a_second_time_as_a_file_that_readers_of_messages_skip(writing):
    path = writing.begin(range(3), text=True).finish().path
    with (path / "bag_0.mcap").open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        (attachment,) = reader.iter_attachments()
        summary = reader.get_summary()
        assert (summary.statistics.attachment_count, summary.statistics.message_count) == (1, 4)
        assert len(list(reader.iter_messages())) == 4
    ((_, channel, message),) = make_reader(BytesIO(attachment.data), validate_crcs=True).iter_messages()
    assert (channel.topic, message.data) == (TEXT[0], writing.text)
    with AnyReader([path]) as rosbags_reader:
        read = [(item.topic, cdr) for item, _, cdr in rosbags_reader.messages()]
    assert read == [(TEXT[0], writing.text), *[(CLOCK[0], writing.clock)] * 3]


def test_a_disk_without_room_for_the_second_copies_still_gets_the_end_of_the_bag(writing, disk, monkeypatch):
    writer = writing.begin(())
    writer.write(*TEXT, np.random.default_rng(0).bytes(100_000), 0)
    writing.write_clocks(writer, [0])
    disk.room_bytes = 150_000
    with pytest.raises(EpisodeError, match="disk is full"):
        writer.finish()
    monkeypatch.setattr(WorkingFolder, "free_reserve", disk.frees(30_000))
    summary = writer.abandon("the disk is full")
    with open_bag(summary.path) as bag:
        assert [message.topic for message in bag.messages()] == [TEXT[0], CLOCK[0]]


KILLED_WRITER = """
    import sys
    from pathlib import Path
    from rosbags.typesys import Stores, get_typestore
    from siren_ros.data.recording.bag_writer import BagOptions, EpisodeBagWriter
    store = get_typestore(Stores.ROS2_JAZZY)
    writer = EpisodeBagWriter(Path(sys.argv[1]), store, options=BagOptions(chunk_bytes=1000))
    for step in range(1_000_000_000):
        writer.write("/data", "std_msgs/msg/String", bytes(500), step * 50_000_000)
        if step == 200:
            print("written", flush=True)
"""


def test_a_killed_writer_leaves_whole_chunks_and_no_lock(writing):
    command = [sys.executable, "-c", textwrap.dedent(KILLED_WRITER), str(writing.folder / "bag")]
    with subprocess.Popen(command, stdout=subprocess.PIPE, env=os.environ) as process:
        assert process.stdout.readline() == b"written\n"
        process.send_signal(signal.SIGKILL)
    kinds = []
    with (writing.folder / ".bag.partial" / "bag_0.mcap").open("rb") as data:
        records = StreamReader(data).records
        with suppress(McapError, struct.error):  # the file ends within a record
            kinds.extend(type(record).__name__ for record in records)
    assert kinds.count("Message") >= 190
    writing.begin().finish()
    assert writing.names() == ["bag", "bag.partial"]
