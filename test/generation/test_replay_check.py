import dataclasses

import pytest

from siren_ros.errors import BagError, InputError, MapError
from siren_ros.generation.closed_loop import LoopStep, closed_loop, record_of
from siren_ros.generation.episode_setup import (
    default_bag_path,
    default_bag_path_of,
    default_kitti_path,
    plan_length,
    set_up_episode,
)
from siren_ros.generation.replay_check import first_difference, repeat_episode, request_of
from siren_ros.recording.episode_record import EpisodeRecord
from siren_ros.scenario.request import EpisodeRequest

STEPS = 40
REQUEST = EpisodeRequest("S2", seed=3, sensors="none")


@pytest.fixture(scope="module")
def episode() -> tuple[EpisodeRecord, list[LoopStep]]:
    setup = set_up_episode(REQUEST)
    steps = list(closed_loop(setup, STEPS))
    return record_of(setup, steps), steps


def test_a_record_is_repeated_to_the_last_bit(episode: tuple[EpisodeRecord, list[LoopStep]]) -> None:
    record, _ = episode
    assert request_of(record) == REQUEST
    assert repeat_episode(record) is None


def test_the_first_difference_is_named(episode: tuple[EpisodeRecord, list[LoopStep]]) -> None:
    record, steps = episode
    state = record.states[17]
    x_m = state.x_m.copy()
    x_m[4] += 1e-12
    changed = (*record.states[:17], dataclasses.replace(state, x_m=x_m), *record.states[18:])
    difference = first_difference(changed, steps)
    assert difference is not None
    assert (difference.step, difference.actor_id, difference.field) == (17, int(state.actor_id[4]), "x_m")
    assert str(difference).startswith(f"step 17, actor {state.actor_id[4]}, x_m: recorded ")


def test_another_signal_alone_is_found_by_the_hash(episode: tuple[EpisodeRecord, list[LoopStep]]) -> None:
    record, steps = episode
    hashes = {**record.state_hashes, 11: 1}
    difference = first_difference(record.states, steps, hashes)
    assert difference is not None
    assert str(difference).startswith("step 11, state_hash: recorded 0000000000000001, repeated ")


def test_another_seed_is_another_episode(episode: tuple[EpisodeRecord, list[LoopStep]]) -> None:
    record, _ = episode
    parameters = {**record.description.parameters, "request": dataclasses.asdict(REQUEST) | {"seed": 4}}
    other = dataclasses.replace(record, description=dataclasses.replace(record.description, parameters=parameters))
    difference = repeat_episode(other)
    assert difference is not None
    assert difference.step == 0


@pytest.mark.parametrize("stored", [None, {}, {"template": "S2", "shoe_size": 44}, {"template": 7}])
def test_a_description_without_its_request_is_refused(
    episode: tuple[EpisodeRecord, list[LoopStep]], stored: object
) -> None:
    record, _ = episode
    description = dataclasses.replace(record.description, parameters={"request": stored})
    with pytest.raises(BagError, match="request"):
        repeat_episode(dataclasses.replace(record, description=description))


def test_names_and_lengths_come_from_the_request() -> None:
    assert default_bag_path(REQUEST).as_posix() == "bags/S2_L2_seed3"
    there = dataclasses.replace(REQUEST, map="maps/Some Town.net.xml", level="L1")
    assert default_bag_path(there).as_posix() == "bags/S2_L1_seed3_Some Town"
    assert plan_length(dataclasses.replace(REQUEST, duration_s=2.5)) == 50


def test_the_names_can_be_told_from_the_description_alone() -> None:
    for change in ({}, {"level": "L1", "seed": 7}, {"av": "civilian"}):
        request = dataclasses.replace(REQUEST, **change)
        assert default_bag_path_of(set_up_episode(request).description) == default_bag_path(request)
    assert default_kitti_path(default_bag_path(REQUEST)).as_posix() == "bags/S2_L2_seed3_kitti"


@pytest.mark.parametrize(
    ("change", "error"),
    [
        ({"template": "S77"}, InputError),
        ({"preset": "wild"}, InputError),
        ({"sensors": "sonar"}, InputError),
        ({"map": "nowhere.xodr"}, MapError),
    ],
)
def test_a_request_that_cannot_be_met_is_refused_by_name(change: dict[str, str], error: type[InputError]) -> None:
    with pytest.raises(error) as caught:
        set_up_episode(dataclasses.replace(REQUEST, **change))
    assert caught.value.parameter == next(iter(change))
