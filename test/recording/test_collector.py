import random
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from siren_ros.errors import EpisodeError
from siren_ros.interfaces import topics
from siren_ros.recording.collector import MAX_STEPS_AHEAD, StepCollector

SLOW = replace(topics.GROUND_TRUTH, period_steps=3)
EXPECTED = (topics.EPISODE, topics.MAP, topics.CLOCK, topics.ACTORS, SLOW, topics.OUTCOME)
STEPS = 5


def _arrivals() -> list[tuple[str, int]]:
    arrivals = [(topics.EPISODE.name, 0), (topics.MAP.name, 0)]
    for step in range(STEPS):
        arrivals += [(topics.CLOCK.name, step), (topics.ACTORS.name, step)]
        arrivals += [(SLOW.name, step)] if step % 3 == 0 else []
    return arrivals


def _collected(arrivals: list[tuple[str, int]]) -> list[tuple[str, int, bytes]]:
    collector = StepCollector(EXPECTED)
    out = []
    for name, step in arrivals:
        collector.add(name, step, f"{name}@{step}".encode())
        out += [(item.topic.name, item.step, item.cdr) for item in collector.ready()]
    return out


@given(st.randoms(use_true_random=False))
def test_the_order_of_arrival_changes_nothing(shuffler: random.Random) -> None:
    arrivals = _arrivals()
    shuffler.shuffle(arrivals)
    expected = [(name, step, f"{name}@{step}".encode()) for name, step in _arrivals()]
    assert _collected(arrivals) == expected


def test_says_what_is_missing_and_from_whom() -> None:
    collector = StepCollector(EXPECTED)
    for name, step in _arrivals():
        if (name, step) not in {(topics.ACTORS.name, 1), (SLOW.name, 3)}:
            collector.add(name, step, b"")
    assert len(list(collector.ready())) == 2 + 3
    assert collector.next_step == 1
    assert collector.pending_steps == (1, 2, 3, 4)
    assert [str(item) for item in collector.missing(4)] == [
        "/siren/actor_states of vehicle_dynamics at step 1",
        "/emv/ground_truth of sensor_sim at step 3",
    ]


def test_nothing_is_recorded_before_the_latched_topics() -> None:
    collector = StepCollector(EXPECTED)
    for name, step in _arrivals()[1:]:
        collector.add(name, step, b"")
    assert list(collector.ready()) == []
    assert str(collector.missing(0)[0]) == "/siren/episode of sumo_bridge before step 0"
    collector.add(topics.EPISODE.name, 0, b"")
    assert len(list(collector.ready())) == len(_arrivals())


def test_a_message_64_steps_ahead_is_taken_and_one_further_on_is_not() -> None:
    for done in range(2):
        collector = StepCollector(EXPECTED)
        for name, step in _arrivals()[: 2 + 3 * done]:
            collector.add(name, step, b"")
        list(collector.ready())
        assert collector.next_step == done
        collector.add(topics.CLOCK.name, done + MAX_STEPS_AHEAD, b"")
        with pytest.raises(EpisodeError, match="which has not begun"):
            collector.add(topics.CLOCK.name, done + MAX_STEPS_AHEAD + 1, b"")


def test_a_dying_episode_keeps_incomplete_steps_in_order() -> None:
    collector = StepCollector(EXPECTED)
    for name, step in [(topics.MAP.name, 0), (topics.ACTORS.name, 2), (topics.CLOCK.name, 2), (SLOW.name, 0)]:
        collector.add(name, step, b"")
    left = [(item.topic.name, item.step) for item in collector.drain()]
    assert left == [(topics.MAP.name, 0), (SLOW.name, 0), (topics.CLOCK.name, 2), (topics.ACTORS.name, 2)]
    assert list(collector.drain()) == []


@pytest.mark.parametrize(
    ("name", "step"),
    [
        ("/foreign", 0),
        (topics.CLOCK.name, 0),
        (topics.CLOCK.name, 1),
        (SLOW.name, 1),
        (topics.CLOCK.name, 900),
        (topics.MAP.name, 0),
        (topics.OUTCOME.name, 4),
    ],
)
def test_refuses_what_it_does_not_expect(name: str, step: int) -> None:
    collector = StepCollector(EXPECTED)
    for arrived, at in [*_arrivals()[:5], (topics.CLOCK.name, 1)]:
        collector.add(arrived, at, b"")
    list(collector.ready())
    with pytest.raises(EpisodeError, match=name):
        collector.add(name, step, b"")


def test_what_is_missing_is_counted_up_to_the_last_step_also_after_gaps() -> None:
    collector = StepCollector(EXPECTED)
    for name in (topics.EPISODE.name, topics.MAP.name):
        collector.add(name, 0, b"")
    list(collector.ready())
    assert [item.step for item in collector.missing(1)] == [0, 0, 0, 1, 1]
    assert [item.step for item in collector.missing(0)] == [0, 0, 0]
    collector.add(topics.CLOCK.name, 2, b"")
    collector.add(topics.CLOCK.name, 4, b"")
    assert [item.step for item in collector.drain()] == [2, 4]
    assert collector.next_step == 5
    assert collector.pending_steps == ()
