"""``siren episode``, and which of its two jobs ``siren replay`` does."""

import struct
import sys
from collections.abc import Callable, Collection
from pathlib import Path

import pytest
from rosbags.typesys.store import Typestore

from siren_ros.base.numerics.units import step_of_time_ns
from siren_ros.data.recording.bag_reader import open_bag, read_episode
from siren_ros.data.recording.bag_writer import EpisodeBagWriter
from siren_ros.running.generation.closed_loop import record_episode
from siren_ros.running.generation.episode_setup import set_up_episode
from siren_ros.simulation.scenario.episode import EpisodeRequest

QUICK = ("--sensors", "none", "--duration-s", "0.5")


def test_it_makes_a_bag_says_how_it_ended_and_what_can_follow(siren, tmp_path: Path, monkeypatch) -> None:
    bag = str(tmp_path / "my bag")
    monkeypatch.chdir(tmp_path)
    siren(["episode", *QUICK])
    assert (tmp_path / "bags" / "S2_L2_seed0" / "metadata.yaml").is_file(), "as cosim does"
    words = ["episode", "S3", "--level", "1", "--seed", "4", *QUICK, "--out", bag]
    printed = siren(words)
    ended, following = printed.out.splitlines()
    assert ended.startswith(f"{bag} (")
    assert "episode complete after 0.50 s; its interaction did not happen" in ended
    assert f"`siren verify '{bag}'`" in following
    request = read_episode(Path(bag)).description.asked
    expected = EpisodeRequest("S3", "L1", 4, sensors="none", duration_s=0.5)
    assert request == expected.to_json()
    assert "--overwrite" in siren(words, 2).err
    siren([*words, "--overwrite"])
    siren([*words, "--overwrite", "--strict"], 1)


@pytest.mark.parametrize(
    ("words", "named"),
    [(["S9"], "template: 'S9'"), (["--level", "L7"], "level: 'L7'"), (["--duration-s", "-1"], "duration_s: -1.0")],
)
def test_bad_choices_are_one_line(siren, words: list[str], named: str) -> None:
    printed = siren(["episode", *words], 2)
    assert printed.err.startswith(f"siren episode: {named} cannot be used")
    assert printed.err.count("\n") == 1


@pytest.fixture
def bag(tmp_path: Path, write_bag: Callable[..., Path]) -> Path:
    return write_bag(tmp_path / "bag", duration_s=0.5)


def test_it_becomes_the_player(bag: Path, becomes, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(bag.parent)
    options = ["--rate", "2", "--start", "0.25", "--loop", "--paused"]
    options += ["--topics", "/tf", "/b", "--playback-duration", "1.5", "--remap", "/tf:=/mine", "b:=c"]
    became = becomes(["replay", "bag", *options])
    assert became[:4] == [sys.executable, "-m", "siren_nodes.player", "--ros-args"]
    assert became[4::2] == [*["-p"] * 7, "-r", "-r"]
    assert became[5:15:2] == [f'bag:="{bag}"', "rate:=2.0", "start_s:=0.25", "loop:=true", "paused:=true"]
    assert became[15::2] == ["playback_duration_s:=1.5", 'topics:=["/tf", "/b"]', "/tf:=/mine", "b:=c"]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["BAG", "--remap", "/tf=/mine"], "--remap: '/tf=/mine' cannot be used"),
        (["nothing"], "nothing"),
        (["--check", "BAG"], "request of the episode"),  # it is made by hand
    ],
)
def test_what_cannot_be_played_or_repeated_is_refused(bag: Path, siren, words: list[str], said: str) -> None:
    assert said in siren(["replay", *(str(bag) if word == "BAG" else word for word in words)], 2).err


@pytest.fixture(scope="module")
def simulated_bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The bag of ten steps that the simulation made."""
    bag = tmp_path_factory.mktemp("made") / "bag"
    record_episode(set_up_episode(EpisodeRequest("S2", seed=3, sensors="none", duration_s=0.5)), bag)
    return bag


def without_steps(made: Path, bag: Path, typestore: Typestore, left_out: Collection[int], other: int = -1) -> str:
    """The bag without the messages of some steps, one with other states; its end and its outcome stay as they are."""
    with open_bag(made) as opened:
        writer = EpisodeBagWriter(bag, typestore, opened.latched)
        for message in opened.messages():
            step, cdr = step_of_time_ns(message.time_ns), message.cdr
            if message.topic == "/siren/actor_states" and step == other:
                cdr = cdr[:-8] + struct.pack("<d", 1e3)
            if message.topic in opened.latched or step not in left_out:
                writer.write(message.topic, message.type_name, cdr, message.time_ns)
    return str(writer.finish().path)


@pytest.mark.parametrize(("left_out", "held"), [(range(3, 10), 3), ((0, 1, 6), 7)])
def test_a_bag_that_lacks_steps_is_compared_as_far_as_it_goes_and_not_called_complete(
    simulated_bag, tmp_path, typestore, siren, left_out, held
) -> None:
    last = read_episode(simulated_bag).state_hashes[9]
    over = f"over 10 steps (last state hash {last:016x})"
    assert over in siren(["replay", "--check", str(simulated_bag)]).out
    bag = without_steps(simulated_bag, tmp_path / "bag", typestore, left_out)
    printed = siren(["replay", "--check", bag], 1)
    assert f"the same, to the last bit, over {held} steps" in printed.out
    assert printed.err == f"siren replay: {bag} is not complete: it holds {held} of 10 steps\n"
    assert f"failed (the bag holds {held} of the 10 steps that were closed), not judged" in siren(["info", bag]).out
    assert "complete, complete" not in siren(["verify", bag], 1).out


def test_a_difference_in_a_step_that_is_there_is_still_found(simulated_bag, tmp_path, typestore, siren) -> None:
    bag = without_steps(simulated_bag, tmp_path / "bag", typestore, (2,), other=7)
    assert "differs first at step 7" in siren(["replay", "--check", bag], 1).out
