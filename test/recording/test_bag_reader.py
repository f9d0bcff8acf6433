import io
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from rosbags.typesys.store import Typestore
from synthetic_episode import EMV, Scene, SyntheticEpisode

from siren_ros.errors import BagError
from siren_ros.interfaces.messages import make_message
from siren_ros.interfaces.topics import ACTORS, MAP
from siren_ros.recording.bag_guard import read_summary
from siren_ros.recording.bag_reader import open_bag, read_episode
from siren_ros.recording.bag_writer import EpisodeBagWriter
from siren_ros.recording.episode_record import EpisodeRecord
from siren_ros.recording.mcap_scan import DamageError
from siren_ros.world.actors import ACTOR_STATE_DTYPES
from siren_ros.world.events import EventKind


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory, write_bag: Callable[..., Path]) -> Path:
    return write_bag(tmp_path_factory.mktemp("bags") / "S2_L2_seed0", lidar=True)


def test_the_record_is_what_was_recorded(bag: Path) -> None:
    made = SyntheticEpisode(Scene(lidar=True))
    record = read_episode(bag)
    assert record.description == made.description
    assert record.actors == made.actors
    assert record.outcome == made.outcome()
    assert record.complete
    assert record.steps == made.steps
    assert record.duration_s == pytest.approx(16.0)
    assert [lane.lane_id for lane in record.network.lanes][:2] == ["east_0", "east_1"]
    for step in (0, 100, made.steps - 1):
        for name in ACTOR_STATE_DTYPES:
            assert np.array_equal(getattr(record.states[step], name), getattr(made.states(step), name))
        assert np.array_equal(record.traffic[step].lane, made.traffic(step).lane)
        assert len(record.commands["emv_controller"][step]) == 1
    assert len(record.events_of(EventKind.YIELD_COMPLETED)) == 4
    assert record.emv_ids == (EMV,)


def test_a_track_is_one_actor_in_the_order_of_time(bag: Path) -> None:
    record = read_episode(bag)
    track = record.track(3)
    assert np.array_equal(track.step, np.arange(record.steps))
    assert np.allclose(track.xy_m, SyntheticEpisode().paths[3][:, :2])
    assert len(record.track(999)) == 0


def test_topics_are_counted_with_their_times(bag: Path) -> None:
    topics = read_episode(bag).topics
    assert topics["/emv/lidar/points"].count == 160
    assert np.array_equal(topics["/emv/lidar/points"].times_ns, np.arange(160) * 100_000_000)
    assert sum(topic.stamp_mismatches for topic in topics.values()) == 0


def test_a_live_record_equals_the_one_that_is_read(bag: Path, record_of: Callable[..., EpisodeRecord]) -> None:
    live, read = record_of(lidar=True), read_episode(bag)
    assert live.events == read.events
    assert np.array_equal(live.rows.xy_m, read.rows.xy_m)


def _copy(bag: Path, tmp_path: Path) -> tuple[Path, Path]:
    copy = tmp_path / bag.name
    shutil.copytree(bag, copy)
    return copy, next(copy.glob("*.mcap"))


@pytest.mark.parametrize("name", ["nowhere", "nowhere" * 50])
def test_a_missing_bag_is_named(tmp_path: Path, name: str) -> None:
    with pytest.raises(BagError, match=rf"{name}.*exists"):
        read_episode(tmp_path / name)


def test_a_folder_without_metadata_is_no_bag(tmp_path: Path) -> None:
    with pytest.raises(BagError, match=r"metadata\.yaml"):
        read_episode(tmp_path)


def test_a_bag_that_was_cut_off_says_so(bag: Path, tmp_path: Path) -> None:
    copy, _ = _copy(bag, tmp_path)
    (copy / "metadata.yaml").unlink()
    with pytest.raises(BagError, match="cut off"):
        read_episode(copy)


@pytest.mark.parametrize("share", [0.0, 0.3, 0.9, 0.999])
def test_a_truncated_bag_is_refused(bag: Path, tmp_path: Path, share: float) -> None:
    copy, mcap = _copy(bag, tmp_path)
    mcap.write_bytes(mcap.read_bytes()[: int(mcap.stat().st_size * share)])
    with pytest.raises(BagError, match="undamaged"):
        read_episode(copy)


@pytest.mark.parametrize("share", [0.0, 0.1, 0.4, 0.7, 0.999])
def test_a_flipped_bit_is_refused(bag: Path, tmp_path: Path, share: float) -> None:
    copy, mcap = _copy(bag, tmp_path)
    data = bytearray(mcap.read_bytes())
    data[int((len(data) - 1) * share)] ^= 0x10
    mcap.write_bytes(data)
    with pytest.raises(BagError):
        read_episode(copy)


def test_damaged_metadata_is_refused(bag: Path, tmp_path: Path) -> None:
    copy, _ = _copy(bag, tmp_path)
    (copy / "metadata.yaml").write_text("rosbag2_bagfile_information: [")
    with pytest.raises(BagError):
        read_episode(copy)


def test_a_bag_of_another_program_is_refused(tmp_path: Path, typestore: Typestore) -> None:
    writer = EpisodeBagWriter(tmp_path / "foreign", typestore)
    message = make_message("std_msgs/msg/String", data="hello")
    writer.write("/chatter", "std_msgs/msg/String", bytes(typestore.serialize_cdr(message, message.__msgtype__)), 0)
    with pytest.raises(BagError, match="episode's description"):
        read_episode(writer.finish().path)


def test_a_known_topic_of_another_type_is_refused(tmp_path: Path, typestore: Typestore) -> None:
    writer = EpisodeBagWriter(tmp_path / "foreign", typestore)
    message = make_message("std_msgs/msg/String", data="hello")
    cdr = bytes(typestore.serialize_cdr(message, message.__msgtype__))
    writer.write("/siren/episode", "std_msgs/msg/String", cdr, 0)
    with pytest.raises(BagError, match="siren_msgs/msg/EpisodeDescription"):
        read_episode(writer.finish().path)


def test_only_the_topics_that_are_asked_for_are_read(bag: Path) -> None:
    with open_bag(bag) as opened:
        found = list(opened.messages({"/emv/lidar/points"}))
        assert {message.topic for message in found} == {"/emv/lidar/points"}
        assert [message.time_ns for message in found] == [opened.stamp_ns(message) for message in found]
        assert list(opened.messages({"/nothing"})) == []


@pytest.mark.parametrize("length", [0, 3, 36])
def test_a_file_shorter_than_its_end_has_none(length: int) -> None:
    with pytest.raises(DamageError, match="the file has no end"):
        read_summary(io.BytesIO(bytes(length)), length)


def test_a_stamp_is_read_from_the_first_bytes_of_a_stamped_message(bag: Path) -> None:
    """Of another byte order, of another type and of fewer bytes there is none."""
    with open_bag(bag) as opened:
        states, text = (
            next(message for message in opened.messages({topic}) if message.time_ns > 0 or topic == MAP.name)
            for topic in (ACTORS.name, MAP.name)
        )
        assert opened.stamp_ns(states) == states.time_ns
        assert opened.stamp_ns(replace(states, cdr=b"\x00\x00" + bytes(states.cdr[2:]))) is None
        assert opened.stamp_ns(replace(states, cdr=bytes(states.cdr[:11]))) is None
        assert opened.stamp_ns(replace(states, cdr=bytes(states.cdr[:12]))) == states.time_ns
        assert opened.stamp_ns(replace(states, type_name=text.type_name)) == opened.stamp_ns(text)
