"""When a record is complete: the episode ended as planned, and no step is missing."""

from collections.abc import Callable
from dataclasses import replace

import pytest
from synthetic_episode import Scene, SyntheticEpisode

from siren_ros.interfaces import topics
from siren_ros.interfaces.conversions import to_actor_states
from siren_ros.interfaces.episode_conversions import to_episode_end, to_episode_outcome
from siren_ros.interfaces.lockstep_reports import EpisodeClosing
from siren_ros.numerics.units import time_ns_of_step
from siren_ros.recording.record_builder import RecordBuilder
from siren_ros.scenario.episode import EpisodeEnd, EpisodeOutcome

EPISODE = SyntheticEpisode(Scene(duration_s=0.5))
STEPS = 10


def complete(outcome: EpisodeOutcome | None, steps: Callable[[int], int | None] = lambda step: step) -> bool:
    """Of an episode of ten steps; ``steps`` renumbers or leaves out states."""
    builder = RecordBuilder()
    for topic, step, message in EPISODE.messages():
        if topic == topics.OUTCOME:
            continue
        if topic == topics.ACTORS:
            number = steps(step)
            if number is not None:
                builder.add(topic.name, to_actor_states(replace(EPISODE.states(step), step=number)))
        else:
            builder.add(topic.name, message)
    if outcome is not None:
        builder.add(topics.OUTCOME.name, to_episode_outcome(outcome))
    return builder.build().complete


@pytest.mark.parametrize("steps", [STEPS - 1, STEPS, STEPS + 1])
@pytest.mark.parametrize("end", list(EpisodeEnd))
def test_an_episode_is_complete_with_all_steps_of_its_outcome_and_a_planned_end(steps: int, end: EpisodeEnd) -> None:
    outcome = EpisodeOutcome(end, "", steps, predicate_holds=True)
    assert complete(outcome) is (steps == STEPS and end is EpisodeEnd.COMPLETE)
    assert not complete(None)


def test_a_step_that_is_left_out_or_comes_twice_makes_it_incomplete() -> None:
    whole = EpisodeOutcome(EpisodeEnd.COMPLETE, "", STEPS, predicate_holds=None)
    assert complete(whole)
    assert not complete(replace(whole, steps=STEPS - 1), lambda step: None if step == 4 else step)
    assert not complete(whole, lambda step: 3 if step == 4 else step)
    assert not complete(whole, lambda step: step + 1)


def test_a_stamp_that_is_earlier_or_later_than_the_log_time_is_wrong() -> None:
    """A message without a stamp has none to be wrong."""
    builder = RecordBuilder()
    for topic, step, message in EPISODE.messages():
        builder.add(topic.name, message)
        builder.count(topic.name, topic.type_name, time_ns_of_step(step), 1, time_ns_of_step(step))
    for off_ns, name in ((-1, "/early"), (0, "/right"), (1, "/late"), (None, "/none")):
        for time_ns in (0, 50_000_000):
            builder.count(name, "T", time_ns, 10, None if off_ns is None else time_ns + off_ns)
    found = {name: topic.stamp_mismatches for name, topic in builder.build().topics.items() if topic.type_name == "T"}
    assert found == {"/early": 2, "/right": 0, "/late": 2, "/none": 0}


def builder_of(held: range, closed: int) -> RecordBuilder:
    """The messages of some steps, with an end and an outcome that say how many steps were closed."""
    builder = RecordBuilder()
    for topic, step, message in EPISODE.messages():
        if topic.latched or step in held:
            builder.add(topic.name, message)
    closing = EpisodeClosing(closed, EpisodeEnd.COMPLETE, "")
    builder.add(topics.EPISODE_END.name, to_episode_end(closing))
    return builder


@pytest.mark.parametrize(
    ("held", "closed", "told"),
    [(3, 10, "3 of the 10 steps"), (10, 10, ""), (10, 12, "10 of the 12 steps"), (0, 10, "0 of the 10 steps")],
)
def test_a_bag_without_every_step_that_was_closed_is_not_complete(held: int, closed: int, told: str) -> None:
    record = builder_of(range(held), closed).build()
    assert record.outcome is not None
    assert record.complete is (not told)
    assert record.outcome.end is (EpisodeEnd.FAILED if told else EpisodeEnd.COMPLETE)
    assert told in record.outcome.reason
    assert (record.outcome.predicate_holds is None) is bool(told)
    assert record.lost_steps == closed - held


def test_lost_steps_are_counted_up_to_the_last_one_where_the_bag_has_no_end() -> None:
    builder = RecordBuilder()
    for topic, step, message in EPISODE.messages():
        if topic not in {topics.OUTCOME, topics.EPISODE_END} and (topic.latched or step in {2, 3, 6}):
            builder.add(topic.name, message)
    record = builder.build()
    assert (record.steps, record.lost_steps, record.outcome) == (3, 4, None)
