"""What is checked of a bag's files, what is read of them, which folders are bags, and the playhead."""

import io
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st
from mcap.reader import make_reader
from recording.bag_bytes import chunks_of, flip_bit, rewrite
from synthetic_episode import EMV, Scene, SyntheticEpisode

from siren_ros.data.episode_source import open_source
from siren_ros.data.interfaces import topics
from siren_ros.data.interfaces.messages import make_message
from siren_ros.data.interfaces.topics import ACTORS, MAP
from siren_ros.data.recording import bag_reader
from siren_ros.data.recording.bag_folder import METADATA_FILE
from siren_ros.data.recording.bag_writer import EpisodeBagWriter
from siren_ros.data.recording.mcap_files import DamageError
from siren_ros.errors import BagError
from siren_ros.simulation.world.actors import ACTOR_STATE_DTYPES, EventKind

STEP_NS = 50_000_000


@pytest.fixture
def bag(tmp_path: Path, write_bag: Callable[..., Path]) -> Path:
    return write_bag(tmp_path / "bag", duration_s=1.0)


def test_a_flipped_bit_is_found_where_the_content_is_asked_for(bag):
    bag_reader.check_bag_files(bag, content=True)
    (file,) = bag_reader.storage_files(bag)
    chunk = chunks_of(file)[0]
    rewrite(bag, lambda data: flip_bit(data, chunk.offset + 200, 1))
    bag_reader.check_bag_files(bag)
    with pytest.raises(BagError, match="undamaged"):
        bag_reader.check_bag_files(bag, content=True)


def test_a_summary_is_held_against_its_checksum(bag):
    rewrite(bag, lambda data: flip_bit(data, -60, 1))
    with pytest.raises(BagError, match="summary does not have its checksum"):
        bag_reader.check_bag_files(bag)


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
def test_metadata_that_leads_elsewhere_is_refused(bag, values, reason):
    shutil.copy(bag / "bag_0.mcap", bag.parent)
    change(bag, **values)
    with pytest.raises(BagError, match=reason):
        bag_reader.check_bag_files(bag)


def test_a_file_without_an_end_is_refused(bag):
    rewrite(bag, lambda data: data.pop())
    with pytest.raises(BagError, match="the file has no end; `siren recover` completes a bag that was cut off"):
        bag_reader.check_bag_files(bag)


@pytest.mark.parametrize(
    ("at", "byte"), [(0, 0x03), (1, 21), (9, 0), (36, 0x00)], ids=["another record", "its length", "start", "magic"]
)
def test_every_part_of_the_end_counts(bag, at, byte):
    """Opcode, length, start of the summary (here: made 0), of its offsets, checksum and magic: 37 bytes."""

    def change(data: bytearray) -> None:
        end = len(data) - 37
        assert data[end] == 0x02
        if at == 9:
            data[end + 9 : end + 17] = bytes(8)
        data[end + at] = byte

    rewrite(bag, change)
    with pytest.raises(BagError, match="the file has no end"):
        bag_reader.check_bag_files(bag)


def test_definitions_are_those_of_ros_2(bag):
    """In ROS 1 times are built in, and the definition of a message names no package for them."""
    (file,) = bag_reader.storage_files(bag)
    with file.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    texts = [schema.data.decode() for schema in summary.schemas.values()]
    assert any("builtin_interfaces/Time clock" in text for text in texts)
    assert not any(line.startswith("time ") for text in texts for line in text.splitlines())


@pytest.fixture(scope="module")
def recorded_bag(tmp_path_factory: pytest.TempPathFactory, write_bag: Callable[..., Path]) -> Path:
    return write_bag(tmp_path_factory.mktemp("bags") / "S2_L2_seed0", lidar=True)


def test_the_record_is_what_was_recorded(recorded_bag):
    episode = SyntheticEpisode(Scene(lidar=True))
    record = bag_reader.read_episode(recorded_bag)
    assert record.description == episode.description
    assert record.actors == episode.actors
    assert record.outcome == episode.outcome()
    assert record.complete
    assert record.steps == episode.steps
    assert record.duration_s == pytest.approx(16.0)
    assert [lane.lane_id for lane in record.network.lanes][:2] == ["east_0", "east_1"]
    for step in (0, 100, episode.steps - 1):
        for name in ACTOR_STATE_DTYPES:
            assert np.array_equal(getattr(record.states[step], name), getattr(episode.states(step), name))
        assert np.array_equal(record.traffic[step].lane, episode.traffic(step).lane)
        assert len(record.commands["emv_controller"][step]) == 1
    assert len(record.events_of(EventKind.YIELD_COMPLETED)) == 4
    assert record.emv_ids == (EMV,)


def test_topics_are_counted_with_their_times(recorded_bag, record_of):
    read, live = bag_reader.read_episode(recorded_bag), record_of(lidar=True)
    assert live.events == read.events, "a live record equals the one that is read"
    assert np.array_equal(live.rows.xy_m, read.rows.xy_m)
    topics = read.topics
    assert topics["/emv/lidar/points"].count == 160
    assert np.array_equal(topics["/emv/lidar/points"].times_ns, np.arange(160) * 100_000_000)
    assert sum(topic.stamp_mismatches for topic in topics.values()) == 0


@pytest.fixture
def copied(recorded_bag: Path, tmp_path: Path) -> Path:
    """A copy of the recorded bag, to be damaged."""
    return Path(shutil.copytree(recorded_bag, tmp_path / recorded_bag.name))


def test_what_is_no_whole_bag_is_named(copied, tmp_path):
    for name in ("nowhere", "nowhere" * 50):
        with pytest.raises(BagError, match=rf"{name}.*exists"):
            bag_reader.read_episode(tmp_path / name)
    with pytest.raises(BagError, match=r"metadata\.yaml"):
        bag_reader.read_episode(tmp_path)
    for share in (0.999, 0.3, 0.0):
        rewrite(copied, lambda data, share=share: data.__delitem__(slice(int(len(data) * share), None)))
        with pytest.raises(BagError, match="undamaged"):
            bag_reader.read_episode(copied)
    (copied / "metadata.yaml").unlink()
    with pytest.raises(BagError, match="cut off"):
        bag_reader.read_episode(copied)


@pytest.mark.parametrize(
    ("topic", "reason"),
    [("/chatter", "episode's description"), ("/siren/episode", "siren_msgs/msg/EpisodeDescription")],
    ids=["unknown topics", "a known topic of another type"],
)
def test_a_bag_of_another_program_is_refused(tmp_path, typestore, topic, reason):
    writer = EpisodeBagWriter(tmp_path / "foreign", typestore)
    message = make_message("std_msgs/msg/String", data="hello")
    writer.write(topic, "std_msgs/msg/String", bytes(typestore.serialize_cdr(message, message.__msgtype__)), 0)
    with pytest.raises(BagError, match=rf"foreign.*{reason}"):
        bag_reader.read_episode(writer.finish().path)


def test_topics_that_stay_unread_are_missing_from_the_record_and_change_nothing_else(recorded_bag):
    with open_source(recorded_bag) as source:
        whole, tracks = source.record(), source.tracks()
    assert whole.commands
    assert whole.state_hashes
    assert not tracks.commands
    assert not tracks.events
    assert not tracks.state_hashes
    assert (tracks.description, tracks.outcome, tracks.complete) == (whole.description, whole.outcome, whole.complete)
    assert (tracks.steps, len(tracks.traffic)) == (whole.steps, len(whole.traffic))
    for name in ACTOR_STATE_DTYPES:
        assert np.array_equal(getattr(tracks.rows, name), getattr(whole.rows, name))


def test_only_the_topics_that_are_asked_for_are_read(recorded_bag):
    with bag_reader.open_bag(recorded_bag) as opened:
        sweeps = list(opened.messages({"/emv/lidar/points"}))
        assert {message.topic for message in sweeps} == {"/emv/lidar/points"}
        assert [message.time_ns for message in sweeps] == [opened.stamp_ns(message) for message in sweeps]
        assert list(opened.messages({"/nothing"})) == []


@pytest.mark.parametrize("length", [0, 3, 36])
def test_a_file_shorter_than_its_end_has_none(length):
    with pytest.raises(DamageError, match="the file has no end"):
        bag_reader.read_summary(io.BytesIO(bytes(length)), length)


def test_a_stamp_is_read_from_the_first_bytes_of_a_stamped_message(recorded_bag):
    """Of another byte order, of another type and of fewer bytes there is none."""
    with bag_reader.open_bag(recorded_bag) as opened:
        states, text = (
            next(message for message in opened.messages({topic}) if message.time_ns > 0 or topic == MAP.name)
            for topic in (ACTORS.name, MAP.name)
        )
        assert opened.stamp_ns(states) == states.time_ns
        assert opened.stamp_ns(replace(states, cdr=b"\x00\x00" + bytes(states.cdr[2:]))) is None
        assert opened.stamp_ns(replace(states, cdr=bytes(states.cdr[:11]))) is None
        assert opened.stamp_ns(replace(states, cdr=bytes(states.cdr[:12]))) == states.time_ns
        assert opened.stamp_ns(replace(states, type_name=text.type_name)) == opened.stamp_ns(text)


def test_a_folder_of_bags_stands_for_those_at_any_depth_but_in_hidden_folders(tmp_path):
    for name in ("b/deep/er", "a", ".work/half", "b/.x.partial"):
        (tmp_path / name).mkdir(parents=True)
        (tmp_path / name / "x_0.mcap").touch()
    inside = [tmp_path / "a", tmp_path / "b" / "deep" / "er"]
    assert bag_reader.bags_among([tmp_path / "none", inside[1], tmp_path]) == (tmp_path / "none", inside[1], *inside)
    hidden = tmp_path / ".work"
    assert bag_reader.bags_among([hidden]) == (hidden / "half",), "whoever names a hidden folder means it"
    (inside[0] / "x_1.mcap").mkdir()
    (inside[0] / "w_1.mcap").touch()
    assert [path.name for path in bag_reader.storage_files(inside[0])] == ["w_1.mcap", "x_0.mcap"]


def test_the_playhead_keeps_the_rate():
    head = bag_reader.Playhead(0, 10.0, 2.0)
    for tick in range(1, 101):
        head = head.advance(10.0 + tick * 0.01)
    assert head.position_ns == pytest.approx(2e9, abs=100)


@given(st.lists(st.floats(0.0, 10.0), min_size=1), st.floats(0.01, 100.0))
def test_the_playhead_never_runs_back_and_never_jumps(pauses_s, rate):
    head, now_s = bag_reader.Playhead(0, 0.0, rate), 0.0
    for pause_s in pauses_s:
        now_s += pause_s
        before, head = head.position_ns, head.advance(now_s)
        assert 0 <= head.position_ns - before <= bag_reader.MAX_BURST_NS


def test_a_paused_playhead_stands_still_and_goes_on_from_there():
    head = bag_reader.Playhead(0, 0.0, 1.0).pause(0.1, paused=True)
    assert head.position_ns == 100_000_000
    head = head.advance(50.0)
    assert head.position_ns == 100_000_000
    assert head.pause(60.0, paused=False).advance(60.05).position_ns == 150_000_000


def test_held_at_a_message_that_cannot_go_out_it_goes_on_from_there():
    head = bag_reader.Playhead(0, 0.0, 1.0).advance(0.1).held_at(50_000_000)
    assert head.position_ns == 50_000_000
    assert head.advance(0.15).position_ns == pytest.approx(100_000_000, abs=1)
    assert head.held_at(90_000_000) == head


def test_from_the_middle_what_is_latched_comes_first(bag):
    with bag_reader.open_bag(bag) as opened:
        assert [item.cdr for item in bag_reader.messages_from(opened, 0)] == [item.cdr for item in opened.messages()]
        played = list(bag_reader.messages_from(opened, 10 * STEP_NS))
        latched = [item.topic for item in played if item.time_ns < 10 * STEP_NS]
        assert set(latched) == {topics.EPISODE.name, topics.MAP.name}
        assert len(latched) == 2
        rest = [item for item in played if item.time_ns >= 10 * STEP_NS]
        assert played[2:] == rest
        assert [item.cdr for item in rest] == [item.cdr for item in opened.messages() if item.time_ns >= 10 * STEP_NS]
        assert [item.topic for item in bag_reader.messages_from(opened, 10**12)] == [
            item.topic for item in opened.messages() if item.topic in opened.latched
        ]


def test_of_a_latched_topic_the_last_message_before_the_start_comes():
    messages = [SimpleNamespace(topic="/latched", time_ns=10 * place, cdr=bytes([place])) for place in range(4)]
    messages.insert(2, SimpleNamespace(topic="/other", time_ns=15, cdr=b"other"))
    bag: Any = SimpleNamespace(latched=frozenset({"/latched"}), messages=lambda: iter(messages))
    for start_ns, expected in ((20, [b"\1", b"\2", b"\3"]), (35, [b"\3"]), (15, [b"\1", b"other", b"\2", b"\3"])):
        assert [item.cdr for item in bag_reader.messages_from(bag, start_ns)] == expected
