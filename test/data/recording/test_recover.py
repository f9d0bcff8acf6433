import shutil
import struct
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from recording.bag_bytes import chunks_of, flip_bit, rewrite
from rosbags.typesys.store import Typestore

from siren_ros.cli.main import main
from siren_ros.data.interfaces.messages import make_message, stamp
from siren_ros.data.recording.bag_reader import open_bag, read_episode
from siren_ros.data.recording.bag_writer import BagOptions, EpisodeBagWriter
from siren_ros.data.recording.mcap_files import parse_content, unpack
from siren_ros.data.recording.recover import recover_bag
from siren_ros.errors import BagError
from siren_ros.scoring.judging.verify import verify_episode

CLOCK = ("/clock", "rosgraph_msgs/msg/Clock")
Messages = list[tuple[str, int, bytes]]


@pytest.fixture(scope="module")
def episode(tmp_path_factory: pytest.TempPathFactory, write_bag: Callable[..., Path]) -> Path:
    """A complete bag of three seconds, and so of several chunks."""
    return write_bag(tmp_path_factory.mktemp("episode") / "bag", duration_s=3.0)


def cut_off(episode: Path, folder: Path, share: float | None = None) -> Path:
    """What a writer that was killed leaves: the hidden folder with a part of the file, and the reserve.

    Without a share the cut is within the last chunk.
    """
    working, data = folder / ".bag.partial", (episode / "bag_0.mcap").read_bytes()
    end = chunks_of(episode / "bag_0.mcap")[-1].offset + 50 if share is None else int(len(data) * share)
    working.mkdir()
    (working / "bag_0.mcap").write_bytes(data[:end])
    (working / ".reserve").write_bytes(bytes(1000))
    return working


@pytest.fixture
def damaged(episode: Path, tmp_path: Path) -> Path:
    """A copy of the bag, to be damaged."""
    return Path(shutil.copytree(episode, tmp_path / "damaged"))


def messages_of(bag: Path) -> Messages:
    with open_bag(bag) as opened:
        return [(message.topic, message.time_ns, message.cdr) for message in opened.messages()]


@pytest.fixture(scope="module")
def whole(episode: Path) -> Messages:
    """The messages of the complete bag."""
    return messages_of(episode)


@pytest.mark.parametrize("named", [".bag.partial", "bag"])
def test_a_cut_off_bag_is_completed_with_all_its_whole_chunks(episode, whole, tmp_path, named):
    working = cut_off(episode, tmp_path)
    chunks = chunks_of(episode / "bag_0.mcap")
    recovery = recover_bag(tmp_path / named)
    assert recovery.path == tmp_path / "bag.partial"
    assert not working.exists()
    assert not recovery.healthy
    saved = chunks_of(recovery.path / "bag_0.mcap")
    assert 1 < len(saved) < len(chunks)
    assert [chunk.packed for chunk in saved] == [chunk.packed for chunk in chunks[: len(saved)]]
    messages = messages_of(recovery.path)
    assert recovery.messages == len(messages)
    assert messages == whole[: len(messages)]
    record = read_episode(recovery.path)
    assert not record.complete
    assert record.steps == recovery.steps > 20
    with (recovery.path / "bag_0.mcap").open("rb") as stream:
        summary = make_reader(stream, validate_crcs=True).get_summary()
    assert summary.statistics.message_count == recovery.messages


def test_recovering_again_changes_nothing(episode, tmp_path):
    cut_off(episode, tmp_path)
    first = recover_bag(tmp_path / "bag")
    before = {file.name: file.read_bytes() for file in first.path.iterdir()}
    again = recover_bag(first.path)
    assert (again.healthy, again.path, again.messages, again.steps) == (True, first.path, first.messages, first.steps)
    assert {file.name: file.read_bytes() for file in first.path.iterdir()} == before
    assert [path.name for path in tmp_path.iterdir()] == ["bag.partial"]


def test_a_complete_bag_is_left_alone(episode, capsys):
    assert main(["recover", str(episode)]) == 0
    assert "complete as it is" in capsys.readouterr().out
    assert [path.name for path in episode.parent.iterdir()] == ["bag"]


@settings(max_examples=20)
@given(share=st.floats(0.0, 1.0))
def test_a_bag_cut_off_anywhere_gives_its_beginning_or_one_error(episode, whole, tmp_path_factory, share):
    folder = tmp_path_factory.mktemp("cut")
    cut_off(episode, folder, share)
    try:
        recovery = recover_bag(folder / "bag")
    except BagError:
        assert share < 0.5, "the first chunk, which holds the map, is not there"
        return
    messages = messages_of(recovery.path)
    assert messages == whole[: len(messages)]
    shutil.rmtree(folder)


def with_flipped_bits(bag: Path, *numbers: int) -> list[int]:
    """Flips a bit in some chunks of a bag; returns the number of messages in each."""
    chunks = [chunks_of(next(bag.glob("*.mcap")))[number] for number in numbers]
    for chunk in chunks:
        rewrite(bag, lambda data, packed=chunk.packed: flip_bit(data, data.index(packed) + len(packed) // 2))
    return [len(parse_content(unpack(chunk)).messages) for chunk in chunks]


def steps_of(bag: Path, number: int) -> Messages:
    """The messages of a chunk, without those of latched topics, which stand a second time."""
    latched = {"/siren/episode", "/siren/map", "/siren/outcome"}
    with open_bag(bag) as opened:
        names = {connection.id: connection.topic for connection in opened.reader.connections}
    content = parse_content(unpack(chunks_of(next(bag.glob("*.mcap")))[number]))
    messages = [(names[item.channel_id], item.time_ns, item.data) for item in content.messages]
    return [message for message in messages if message[0] not in latched]


def test_a_flipped_bit_in_the_first_chunk_costs_nothing_because_its_messages_stand_twice(
    episode, whole, damaged, capsys
):
    (lost,) = with_flipped_bits(damaged, 0)
    assert main(["recover", str(damaged)]) == 0
    printed = capsys.readouterr()
    assert f"saved {len(whole)} messages" in printed.out
    assert f"{lost} of them from their second copies" in printed.out
    assert printed.err == ""
    saved = damaged.with_name("damaged.partial")
    assert messages_of(saved) == whole
    assert verify_episode(read_episode(saved)) == verify_episode(read_episode(episode))
    with_flipped_bits(saved, 0)
    assert messages_of(recover_bag(saved, damaged.with_name("again")).path) == whole, "a recovered bag has copies too"


def bag_of_texts(
    path: Path, store: Typestore, *topics: str, latched: tuple[str, ...] = ("/siren/episode", "/siren/map")
) -> Path:
    """A bag with a text of each topic, each in a chunk of its own."""
    writer = EpisodeBagWriter(path, store, latched, BagOptions(chunk_bytes=64))
    for topic in topics:
        text = make_message("std_msgs/msg/String", data=topic * 20)
        writer.write(topic, "std_msgs/msg/String", bytes(store.serialize_cdr(text, "std_msgs/msg/String")), 0)
    return writer.finish().path


def test_description_and_map_in_two_damaged_chunks_cost_nothing(tmp_path, typestore):
    bag = bag_of_texts(tmp_path / "bag", typestore, "/siren/episode", "/siren/map", "/clock")
    whole = messages_of(bag)
    with_flipped_bits(bag, 0, 1)
    recovery = recover_bag(bag)
    assert (recovery.lost_messages, recovery.restored, recovery.described) == (0, 2, True)
    assert messages_of(recovery.path) == whole


def test_flipped_bits_in_the_first_chunk_and_others_cost_messages_of_steps_only(episode, whole, damaged):
    last = len(chunks_of(episode / "bag_0.mcap")) - 1
    lost = [*steps_of(episode, 0), *steps_of(episode, 1), *steps_of(episode, last)]
    assert lost
    with_flipped_bits(damaged, 0, 1, last)
    recovery = recover_bag(damaged)
    assert (recovery.lost_messages, recovery.restored, recovery.described) == (len(lost), 3, True)
    assert messages_of(recovery.path) == [message for message in whole if message not in lost]
    record = read_episode(recovery.path)
    assert (record.complete, record.steps + record.lost_steps) == (False, 60)


def test_a_flipped_bit_in_the_second_copies_alone_costs_nothing(episode, whole, damaged):
    rewrite(damaged, lambda data: flip_bit(data, data.index(b"published_once.mcap") + 200, 1))
    assert messages_of(damaged) == whole
    recovery = recover_bag(damaged)
    assert not recovery.healthy
    assert (recovery.lost_messages, recovery.restored) == (0, 0)
    assert (recovery.path / "damaged_0.mcap").read_bytes() == (episode / "bag_0.mcap").read_bytes()


def test_a_flipped_bit_anywhere_costs_one_chunk_at_most_and_nothing_in_silence(tmp_path, write_bag):
    episode = write_bag(tmp_path / "bag", duration_s=0.5)
    whole = messages_of(episode)
    file = episode / "bag_0.mcap"
    data = file.read_bytes()
    largest = max(len(steps_of(episode, number)) for number in range(len(chunks_of(file))))
    places = np.linspace(0, len(data) - 1, 24).astype(int).tolist()
    for number, place in enumerate(places):
        changed = bytearray(data)
        changed[place] ^= 1 << number % 8
        file.write_bytes(changed)
        with suppress(BagError):
            assert messages_of(episode) == whole, f"byte {place}: read as if nothing were wrong"
        saved = recover_bag(episode, tmp_path / f"saved{number}")
        assert saved.described, f"byte {place}"
        assert saved.messages + saved.lost_messages == len(whole)
        assert saved.lost_messages <= largest
        kept = messages_of(saved.path)
        assert kept == [message for message in whole if message in set(kept)]


@pytest.mark.parametrize("flipped", [1, 2])
def test_a_cut_off_bag_with_flipped_bits_in_its_first_chunks_keeps_all_others(episode, whole, tmp_path, flipped):
    working = cut_off(episode, tmp_path)
    first = chunks_of(episode / "bag_0.mcap")[:flipped]
    for chunk in first:
        rewrite(working, lambda data, offset=chunk.offset: flip_bit(data, offset + 9 + 100))
    recovery = recover_bag(working)
    # The second copies are cut off, with the end of the file.
    lost = sum(len(parse_content(unpack(chunk)).messages) for chunk in first)
    assert recovery.lost_messages == lost
    saved = messages_of(recovery.path)
    assert 0 < len(saved) == recovery.messages
    assert saved == whole[lost : lost + len(saved)]


@pytest.mark.parametrize(("damaged", "described"), [("/siren/episode", False), ("/siren/map", False), ("/clock", True)])
def test_an_episode_needs_its_description_and_its_map(tmp_path, typestore, damaged, described):
    topics = ("/siren/episode", "/siren/map", "/clock", "/other")
    bag = bag_of_texts(tmp_path / "bag", typestore, *topics, latched=())
    with_flipped_bits(bag, topics.index(damaged))
    recovery = recover_bag(bag)
    assert (recovery.described, recovery.messages, recovery.lost_messages) == (described, 3, 1)
    assert {topic for topic, _, _ in messages_of(recovery.path)} == {*topics} - {damaged}


def test_the_messages_of_several_damaged_chunks_are_told_in_one_line(damaged, capsys):
    lost = with_flipped_bits(damaged, 1, 2)
    assert main(["recover", str(damaged)]) == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert f" {sum(lost)} messages are lost: 2 of " in line
    assert line.count("byte") == 1


@pytest.mark.parametrize("flipped", [False, True])
def test_the_unfinished_end_of_a_killed_writer_is_no_failure_but_a_flipped_bit_before_it_is(
    episode, tmp_path, capsys, flipped
):
    working = cut_off(episode, tmp_path)
    second = chunks_of(episode / "bag_0.mcap")[1]
    if flipped:
        rewrite(working, lambda data: flip_bit(data, second.offset + 9 + 100))
    assert main(["recover", str(working)]) == flipped
    (line,) = capsys.readouterr().err.splitlines()
    lost = f" {len(parse_content(unpack(second)).messages)} messages are lost: 1 of "  # by the message index
    assert (lost if flipped else "the unfinished end is lost") in line


def test_a_complete_bag_that_was_cut_off_later_says_how_many_messages_its_metadata_counted(whole, damaged):
    end = chunks_of(damaged / "bag_0.mcap")[-1].offset + 50
    rewrite(damaged, lambda data: data.__delitem__(slice(end, None)))
    recovery = recover_bag(damaged)
    assert recovery.lost_messages == len(whole) - len(messages_of(recovery.path)) > 0


def test_the_bag_of_a_running_writer_is_refused(tmp_path, typestore):
    writer = EpisodeBagWriter(tmp_path / "bag", typestore, options=BagOptions(chunk_bytes=64))
    cdr = bytes(typestore.serialize_cdr(make_message(CLOCK[1], clock=stamp(0)), CLOCK[1]))
    for step in range(20):
        writer.write(*CLOCK, cdr, step * 50_000_000)
    with pytest.raises(BagError, match="no episode is writing"):
        recover_bag(tmp_path / "bag")
    writer.abandon("over")


def test_the_folder_for_the_result_must_be_new(episode, tmp_path):
    working = cut_off(episode, tmp_path)
    with pytest.raises(BagError, match="exists already"):
        recover_bag(working, tmp_path)
    recovery = recover_bag(working, tmp_path / "sub" / "saved")
    assert recovery.path == tmp_path / "sub" / "saved"
    assert read_episode(recovery.path).steps == recovery.steps
    assert working.exists(), "what is recovered to another place stays"


@pytest.mark.parametrize("name", ["nothing", "empty"])
def test_what_is_no_bag_gets_one_line(tmp_path, capsys, name):
    (tmp_path / "empty").mkdir()
    assert main(["recover", str(tmp_path / name)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert str(tmp_path / name) in line


@pytest.mark.parametrize(
    ("place", "claim", "reason"),
    [
        (1, 2**60, "no whole record of a bag with chunks"),
        (9 + 16, 2**60, f"claims {2**60} bytes; 256000000 are allowed"),
        (9 + 36, 2**60, "whose lengths contradict each other"),
    ],
    ids=["record", "plain", "packed"],
)
def test_a_chunk_that_claims_too_much_is_refused(whole, damaged, place, claim, reason):
    first = chunks_of(damaged / "bag_0.mcap")[0].offset
    rewrite(damaged, lambda data: struct.pack_into("<Q", data, first + place, claim))
    with pytest.raises(BagError, match=reason), open_bag(damaged):
        pass
    recovery = recover_bag(damaged, damaged.with_name("saved"))
    assert recovery.messages + recovery.lost_messages == len(whole)
    assert recovery.lost_messages < len(whole) / 2
