from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from synthetic_episode import Scene, SyntheticEpisode

from siren_ros.base.numerics.units import STEP_NS
from siren_ros.data.interfaces import topics
from siren_ros.data.interfaces.conversions import EpisodeClosing, from_episode_end
from siren_ros.data.interfaces.messages import decode_cdr, encode_cdr, typestore
from siren_ros.data.interfaces.topics import ACTORS, CLOCK, EPISODE, EPISODE_END, OUTCOME, PREDICTIONS
from siren_ros.data.recording.bag_reader import open_bag
from siren_ros.data.recording.episode_record import RecordBuilder
from siren_ros.data.recording.recorder import MAX_STEPS_AHEAD, EpisodeRecorder, StepCollector
from siren_ros.errors import EpisodeError
from siren_ros.simulation.scenario.episode import EpisodeEnd, EpisodeOutcome

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
        out += [(topic.name, ready_step, cdr) for topic, ready_step, cdr in collector.ready()]
    return out


@given(st.randoms(use_true_random=False))
def test_the_order_of_arrival_changes_nothing(shuffler):
    arrivals = _arrivals()
    shuffler.shuffle(arrivals)
    expected = [(name, step, f"{name}@{step}".encode()) for name, step in _arrivals()]
    assert _collected(arrivals) == expected


def test_says_what_is_missing_and_from_whom():
    collector = StepCollector(EXPECTED)
    for name, step in _arrivals():
        if (name, step) not in {(topics.ACTORS.name, 1), (SLOW.name, 3)}:
            collector.add(name, step, b"")
    assert len(list(collector.ready())) == 2 + 3
    assert collector.next_step == 1
    assert collector.missing(4) == [
        "/siren/actor_states of vehicle_dynamics at step 1",
        "/emv/ground_truth of sensor_sim at step 3",
    ]


def test_topics_of_several_periods_are_due_each_at_its_own_steps():
    collector = StepCollector((topics.MAP, SLOW, replace(topics.ACTORS, period_steps=2)))
    due = [text.split(" at step ") for text in collector.missing(11)[1:]]
    steps = lambda topic: [int(step) for name, step in due if name.startswith(topic.name)]  # noqa: E731
    assert (steps(SLOW), steps(ACTORS)) == ([0, 3, 6, 9], [0, 2, 4, 6, 8, 10])


def test_nothing_is_recorded_before_the_latched_topics():
    collector = StepCollector(EXPECTED)
    for name, step in _arrivals()[1:]:
        collector.add(name, step, b"")
    assert list(collector.ready()) == []
    assert collector.missing(0)[0] == "/siren/episode of sumo_bridge before step 0"
    collector.add(topics.EPISODE.name, 0, b"")
    assert len(list(collector.ready())) == len(_arrivals())


def test_a_message_64_steps_ahead_is_taken_and_one_further_on_is_not():
    for done in range(2):
        collector = StepCollector(EXPECTED)
        for name, step in _arrivals()[: 2 + 3 * done]:
            collector.add(name, step, b"")
        list(collector.ready())
        assert collector.next_step == done
        collector.add(topics.CLOCK.name, done + MAX_STEPS_AHEAD, b"")
        with pytest.raises(EpisodeError, match="which has not begun"):
            collector.add(topics.CLOCK.name, done + MAX_STEPS_AHEAD + 1, b"")


def test_a_dying_episode_keeps_incomplete_steps_in_order():
    collector = StepCollector(EXPECTED)
    for name, step in [(topics.MAP.name, 0), (topics.ACTORS.name, 2), (topics.CLOCK.name, 2), (SLOW.name, 0)]:
        collector.add(name, step, b"")
    left = [(topic.name, step) for topic, step, _ in collector.drain()]
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
def test_refuses_what_it_does_not_expect(name, step):
    collector = StepCollector(EXPECTED)
    for arrived, at in [*_arrivals()[:5], (topics.CLOCK.name, 1)]:
        collector.add(arrived, at, b"")
    list(collector.ready())
    with pytest.raises(EpisodeError, match=name):
        collector.add(name, step, b"")


def test_what_is_missing_is_counted_up_to_the_last_step_also_after_gaps():
    collector = StepCollector(EXPECTED)
    for name in (topics.EPISODE.name, topics.MAP.name):
        collector.add(name, 0, b"")
    list(collector.ready())
    assert [text.split(" at step ")[1] for text in collector.missing(1)] == ["0", "0", "0", "1", "1"]
    assert [text.split(" at step ")[1] for text in collector.missing(0)] == ["0", "0", "0"]
    collector.add(topics.CLOCK.name, 2, b"")
    collector.add(topics.CLOCK.name, 4, b"")
    assert [step for _, step, _ in collector.drain()] == [2, 4]
    assert collector.next_step == 5


def judge(_record: RecordBuilder, closing: EpisodeClosing) -> EpisodeOutcome:
    return EpisodeOutcome(closing.end, closing.reason, closing.steps, None)


def recorder_of(episode: SyntheticEpisode, path: Path | None) -> EpisodeRecorder:
    latched = frozenset(topic.name for topic in episode.recorded_topics() if topic.latched)
    return EpisodeRecorder(path, typestore(), latched, judge)


def recorded(path: Path | None, expected_path: Path) -> dict[str, bytes]:
    """The messages in the bag of an episode whose recorder got a path at its start, at the description, or both."""
    episode = SyntheticEpisode(Scene(duration_s=1.0))
    recorder = recorder_of(episode, path)
    messages = [
        (topic, step, bytes(typestore().serialize_cdr(message, topic.type_name)))
        for topic, step, message in episode.messages()
        if topic != OUTCOME
    ]
    recorder.take(messages[0][0], messages[0][2])
    assert recorder.steps_recorded == 0
    recorder.expect(tuple(episode.recorded_topics()), expected_path)
    assert recorder.steps_recorded == 0
    for topic, _, cdr in messages[1:]:
        recorder.take(topic, cdr)
    recorder.close(EpisodeClosing(recorder.steps_recorded, EpisodeEnd.COMPLETE, ""))
    with open_bag(path or expected_path) as bag:
        messages = list(bag.messages())
        assert [message.topic for message in messages[-2:]] == [EPISODE_END.name, OUTCOME.name]
        return {f"{message.topic}@{message.time_ns}": bytes(message.cdr) for message in messages}


def test_a_place_that_the_description_gives_serves_as_well(tmp_path):
    at_once = recorded(tmp_path / "given", tmp_path / "unused")
    later = recorded(None, tmp_path / "bags" / "described")
    assert at_once == later
    assert sorted(path.name for path in tmp_path.iterdir()) == ["bags", "given"]


def test_without_a_description_there_is_no_bag(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    recorder = EpisodeRecorder(None, typestore(), frozenset(), judge)
    recorder.take(EPISODE, b"")
    with pytest.raises(EpisodeError, match="description"):
        recorder.close(EpisodeClosing(1, EpisodeEnd.COMPLETE, ""))
    recorder.discard()
    assert not list(tmp_path.iterdir())


def closed(path: Path, steps: int, closing: EpisodeClosing, held_back: str = "") -> EpisodeOutcome:
    """Close an episode of which some steps have arrived; one topic's message of the last step may be missing."""
    episode = SyntheticEpisode(Scene(duration_s=1.0))
    recorder = recorder_of(episode, path)
    recorder.expect(tuple(episode.recorded_topics()), path)
    seen: list[int] = []
    recorder.on_step_recorded = seen.append
    for topic, step, message in episode.messages():
        late = step == steps - 1 and topic.name == held_back
        if topic != OUTCOME and (topic.latched or step < steps) and not late:
            recorder.take(topic, bytes(typestore().serialize_cdr(message, topic.type_name)))
    assert seen == list(range(steps - bool(held_back)))
    outcome, _, _ = recorder.close(closing)
    return outcome


def times_in(path: Path) -> dict[str, list[int]]:
    times: dict[str, list[int]] = {}
    with open_bag(path) as bag:
        for message in bag.messages():
            times.setdefault(message.topic, []).append(message.time_ns)
    return times


def test_end_and_outcome_are_stamped_with_the_last_step(tmp_path):
    closed(tmp_path / "bag", 5, EpisodeClosing(5, EpisodeEnd.COMPLETE, ""))
    times = times_in(tmp_path / "bag")
    assert times[CLOCK.name] == [step * STEP_NS for step in range(5)]
    assert times[EPISODE_END.name] == times[OUTCOME.name] == [4 * STEP_NS]
    closed(tmp_path / "none", 0, EpisodeClosing(0, EpisodeEnd.COMPLETE, ""))
    assert times_in(tmp_path / "none")[OUTCOME.name] == [0], "of no steps"


@pytest.mark.parametrize(("end", "kept"), [(EpisodeEnd.INTERRUPTED, True), (EpisodeEnd.COMPLETE, False)])
def test_an_interrupted_episode_keeps_what_arrived_of_its_last_step(tmp_path, end, kept):
    outcome = closed(tmp_path / "bag", 5, EpisodeClosing(4, end, "why"), held_back=ACTORS.name)
    times = times_in(next(tmp_path.iterdir()))
    assert (4 * STEP_NS in times[CLOCK.name]) is kept
    assert times[ACTORS.name] == [step * STEP_NS for step in range(4)]
    assert times[OUTCOME.name] == [3 * STEP_NS]
    assert (outcome.end, outcome.reason, outcome.steps) == (end, "why", 4)


@pytest.mark.parametrize("arrived", [3, 4])
def test_a_bag_without_every_step_that_was_closed_is_not_complete(tmp_path, arrived):
    """Reports of steps alone, which another program can forge, do not make a bag complete."""
    reason = rf"5 steps were closed, and {arrived} are recorded; missing: /clock of cosim at step {arrived}, "
    with pytest.raises(EpisodeError, match=reason):
        closed(tmp_path / "bag", arrived, EpisodeClosing(5, EpisodeEnd.COMPLETE, ""))
    assert [path.name for path in tmp_path.iterdir()] == ["bag.partial"]
    with open_bag(tmp_path / "bag.partial") as bag:
        (end,) = [message for message in bag.messages() if message.topic == EPISODE_END.name]
        closing = from_episode_end(decode_cdr(typestore(), EPISODE_END, bytes(end.cdr)))
    assert (closing.end, closing.steps) == (EpisodeEnd.FAILED, 5)


def test_an_episode_that_ended_before_its_first_step_leaves_no_bag_and_no_folder(tmp_path):
    bags = tmp_path / "bags"
    outcome = closed(bags / "bag", 0, EpisodeClosing(0, EpisodeEnd.FAILED, "broken"))
    assert (outcome.end, outcome.reason, outcome.steps) == (EpisodeEnd.FAILED, "broken", 0)
    assert not bags.exists()


def test_what_another_programs_serialiser_leaves_in_the_padding_is_not_recorded(tmp_path):
    """Three actors: four bytes between their ids and the numbers of eight bytes."""
    store, numbers = typestore(), np.arange(3.0)
    time, ids = store.types["builtin_interfaces/msg/Time"](0, 0), np.arange(3, dtype=np.uint32)
    clean = encode_cdr(store, PREDICTIONS, store.types[PREDICTIONS.type_name](time, 0, ids, numbers, numbers, numbers))

    def reads_the_same(place: int) -> bool:
        with suppress(EpisodeError):
            read = decode_cdr(store, PREDICTIONS, clean[:place] + b"\x5a" + clean[place + 1 :])
            return read.stamp == time and encode_cdr(store, PREDICTIONS, read) == clean
        return False

    padding = list(filter(reads_the_same, range(4, len(clean))))
    assert len(padding) >= 4
    dirty = bytes(0x5A if place in padding else byte for place, byte in enumerate(clean))
    recorder = EpisodeRecorder(tmp_path / "bag", store, frozenset(), judge)
    recorder.expect((CLOCK, PREDICTIONS), tmp_path / "bag")
    recorder.take(CLOCK, encode_cdr(store, CLOCK, store.types[CLOCK.type_name](time)))
    recorder.take(PREDICTIONS, dirty)
    recorder.close(EpisodeClosing(1, EpisodeEnd.COMPLETE, ""))
    with open_bag(tmp_path / "bag") as bag:
        assert [bytes(message.cdr) for message in bag.messages({PREDICTIONS.name})] == [clean]
