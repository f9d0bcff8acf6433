"""An episode is recorded without ROS. test/nodes/test_without_ros.py compares the bytes with those of the nodes."""

from dataclasses import replace
from hashlib import sha256
from pathlib import Path

import pytest

from siren_ros.data.recording.bag_reader import read_episode
from siren_ros.errors import BagError, EpisodeError, InputError
from siren_ros.running.generation import closed_loop as loop
from siren_ros.running.generation.episode_setup import set_up_episode
from siren_ros.running.generation.recorded_episode import record_episode
from siren_ros.running.generation.replay_check import repeat_episode, request_of
from siren_ros.scoring.judging.verify import check_message_counts, check_state_hashes
from siren_ros.simulation.scenario.episode import EpisodeEnd, EpisodeRequest

REQUEST = EpisodeRequest("S3", seed=4, duration_s=1.5, sensors="none", values="demand.background_vehicles=18.0")


def test_the_bag_is_sound_and_repeats(tmp_path: Path) -> None:
    recorded = record_episode(set_up_episode(REQUEST), tmp_path / "bag")
    assert recorded.outcome.end is EpisodeEnd.COMPLETE
    record = read_episode(tmp_path / "bag")
    assert record.complete
    assert record.steps == 30
    assert request_of(record) == REQUEST
    for check in (check_message_counts, check_state_hashes):
        assert check(record).holds
    assert repeat_episode(record) is None


def test_a_failed_episode_leaves_a_partial_bag(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(loop, "check_residual", _fail_at(7))
    recorded = record_episode(set_up_episode(REQUEST), tmp_path / "bag")
    assert recorded.outcome.end is EpisodeEnd.FAILED
    assert recorded.outcome.steps == 7
    assert "too far apart" in recorded.outcome.reason
    assert not (tmp_path / "bag").exists()
    partial = read_episode(tmp_path / "bag.partial")
    assert partial.steps >= 7
    assert not partial.complete


def test_an_episode_without_a_step_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(loop, "check_residual", _fail_at(0))
    recorded = record_episode(set_up_episode(REQUEST), tmp_path / "bags" / "bag")
    assert recorded.bag is None
    assert list(tmp_path.iterdir()) == []


def _fail_at(step: int):  # type: ignore[no-untyped-def] # stands for check_residual
    def check(states, _limit_m):  # type: ignore[no-untyped-def]
        if states.step == step:
            raise EpisodeError("too far apart")

    return check


def test_an_existing_bag_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "bag").mkdir()
    with pytest.raises(BagError, match="exists already"):
        record_episode(set_up_episode(REQUEST), tmp_path / "bag")


SHORT = EpisodeRequest("S2", duration_s=0.5, sensors="none")


def digest(bag: Path) -> list[tuple[str, str]]:
    return [(path.name, sha256(path.read_bytes()).hexdigest()) for path in sorted(bag.iterdir())]


def test_an_earlier_episode_gives_way_where_that_is_asked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    bag = tmp_path / "bag"
    record_episode(set_up_episode(SHORT), bag)
    first = digest(bag)
    with pytest.raises(BagError, match=r"overwrite:=true.*siren replay .*bag --check"):
        record_episode(set_up_episode(SHORT), bag)
    record_episode(set_up_episode(replace(SHORT, seed=1)), bag, overwrite=True)
    assert digest(bag) != first
    record_episode(set_up_episode(SHORT), bag, overwrite=True)
    assert digest(bag) == first
    monkeypatch.setattr(loop, "check_residual", _fail_at(3))
    record_episode(set_up_episode(SHORT), bag, overwrite=True)
    assert digest(bag) == first
    assert [path.name for path in sorted(tmp_path.iterdir())] == ["bag", "bag.partial"]


@pytest.mark.parametrize("foreign", ["notes.txt", "folder"])
def test_nothing_but_an_episode_gives_way(tmp_path: Path, foreign: str) -> None:
    bag = tmp_path / "bag"
    record_episode(set_up_episode(SHORT), bag)
    (bag / "folder").mkdir() if foreign == "folder" else (bag / foreign).write_text("mine")
    before = sorted(bag.iterdir())
    with pytest.raises(BagError, match="not the bag of an episode alone"):
        record_episode(set_up_episode(SHORT), bag, overwrite=True)
    assert sorted(bag.iterdir()) == before


def test_a_link_to_an_episode_stays(tmp_path: Path) -> None:
    record_episode(set_up_episode(SHORT), tmp_path / "there")
    (tmp_path / "bag").symlink_to(tmp_path / "there")
    with pytest.raises(BagError, match="exists already"):
        record_episode(set_up_episode(SHORT), tmp_path / "bag", overwrite=True)
    assert (tmp_path / "there" / "metadata.yaml").is_file()


def test_an_interrupted_episode_leaves_nothing_and_steps_are_told(tmp_path: Path) -> None:
    told: list[int] = []

    def interrupt(step: int) -> None:
        told.append(step)
        if step == 3:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        record_episode(set_up_episode(SHORT), tmp_path / "bags" / "bag", on_step=interrupt)
    assert told == [0, 1, 2, 3]
    assert list(tmp_path.iterdir()) == []


def test_a_level_has_its_number_too() -> None:
    for level in (3, "3", "l3", "L3"):
        request = replace(SHORT, level=level)  # type: ignore[arg-type] # as users write it
        assert request == replace(SHORT, level="L3")
        assert set_up_episode(request).description.level == 3


def test_an_av_under_test_needs_its_controller(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cosim"):
        record_episode(set_up_episode(EpisodeRequest("S2", av="civilian", sensors="none")), tmp_path / "bag")
