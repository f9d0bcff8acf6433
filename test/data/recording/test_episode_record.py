"""A record from the messages of a bag, and the record itself."""

import math
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import replace

import numpy as np
import pytest
from hand_made_record import EASTBOUND, EMV, NORTHBOUND, Driven, at_speed, crossing, hand_made
from synthetic_episode import Scene, SyntheticEpisode

from siren_ros.base.numerics.units import time_ns_of_step
from siren_ros.data.interfaces import topics
from siren_ros.data.interfaces.conversions import EpisodeClosing, to_actor_states, to_episode_end, to_episode_outcome
from siren_ros.data.recording.episode_record import (
    LAST_STEP,
    LONGEST_S,
    RecordBuilder,
    check_columns,
    check_description,
    check_traffic,
)
from siren_ros.errors import BagError, InputError
from siren_ros.simulation.scenario.episode import EpisodeEnd, EpisodeOutcome
from siren_ros.simulation.world.actors import ACTOR_STATE_DTYPES
from siren_ros.simulation.world.commands import COMMAND_DTYPES, VehicleCommands

RECORD = hand_made(crossing(), {EMV: Driven(NORTHBOUND, np.zeros(3)), 2: Driven(NORTHBOUND, np.full(3, 30.0))})
EPISODE = SyntheticEpisode(Scene(duration_s=0.5))
STEPS = 10


def indices(*values):
    return np.array(values, dtype=np.int32)


def test_durations_are_finite_and_at_most_three_years():
    for duration in (0.0, 30.0, LONGEST_S):
        check_description(replace(RECORD.description, duration_s=duration))
    for duration in (-0.1, math.nextafter(LONGEST_S, math.inf), math.inf, -math.inf, math.nan):
        with pytest.raises(BagError, match="duration_s"):
            check_description(replace(RECORD.description, duration_s=duration))


@pytest.mark.parametrize(("step", "allowed"), [(0, True), (LAST_STEP - 1, True), (-1, False), (LAST_STEP, False)])
def test_steps(step, allowed):
    for check, message, *names in (
        (check_columns, RECORD.states[0], ACTOR_STATE_DTYPES),
        (check_columns, VehicleCommands.empty(0, "node"), COMMAND_DTYPES),
        (check_traffic, RECORD.traffic[0]),
    ):
        with nullcontext() if allowed else pytest.raises(BagError, match="steps from 0"):
            check(replace(message, step=step), *names)


@pytest.mark.parametrize("column", ["x_m", "actor_id", "residual_m"])
def test_columns_have_one_length(column):
    with pytest.raises(BagError, match="columns of one length"):
        check_columns(replace(RECORD.states[0], **{column: getattr(RECORD.states[0], column)[:1]}), ACTOR_STATE_DTYPES)


def traffic_of(actors, offsets, edges):
    """Traffic of so many actors with these routes."""
    plain = RECORD.traffic[0]
    columns = {
        name: np.zeros(actors, value.dtype)
        for name, value in vars(plain).items()
        if isinstance(value, np.ndarray) and name not in {"removed", "route_offset", "route_edges"}
    }
    return replace(plain, **columns, route_offset=indices(*offsets), route_edges=indices(*range(edges)))


def test_routes_lie_within_their_list():
    for routes in ((0, (), 0), (2, (), 0), (0, (0,), 0), (2, (0, 3, 5), 5), (2, (1, 1, 4), 5)):
        check_traffic(traffic_of(*routes))
    reversed_or_beyond = ((2, (0, 3, 6), 5), (2, (-1, 3, 5), 5), (2, (0, 4, 3), 5))
    too_few_or_many = ((2, (0, 3), 5), (2, (0, 1, 2, 3), 5), (1, (0,), 5))
    for routes in (*reversed_or_beyond, *too_few_or_many):
        with pytest.raises(BagError, match="routes that lie within route_edges"):
            check_traffic(traffic_of(*routes))


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
def test_an_episode_is_complete_with_all_steps_of_its_outcome_and_a_planned_end(steps, end):
    outcome = EpisodeOutcome(end, "", steps, predicate_holds=True)
    assert complete(outcome) is (steps == STEPS and end is EpisodeEnd.COMPLETE)
    assert not complete(None)


def test_a_step_that_is_left_out_or_comes_twice_makes_it_incomplete():
    whole = EpisodeOutcome(EpisodeEnd.COMPLETE, "", STEPS, predicate_holds=None)
    assert complete(whole)
    assert not complete(replace(whole, steps=STEPS - 1), lambda step: None if step == 4 else step)
    assert not complete(whole, lambda step: 3 if step == 4 else step)
    assert not complete(whole, lambda step: step + 1)


def test_a_stamp_that_is_earlier_or_later_than_the_log_time_is_wrong():
    """A message without a stamp has none to be wrong."""
    builder = RecordBuilder()
    for topic, step, message in EPISODE.messages():
        builder.add(topic.name, message)
        builder.count(topic.name, topic.type_name, time_ns_of_step(step), 1, time_ns_of_step(step))
    for off_ns, name in ((-1, "/early"), (0, "/right"), (1, "/late"), (None, "/none")):
        for time_ns in (0, 50_000_000):
            builder.count(name, "T", time_ns, 10, None if off_ns is None else time_ns + off_ns)
    mismatches = {
        name: topic.stamp_mismatches for name, topic in builder.build().topics.items() if topic.type_name == "T"
    }
    assert mismatches == {"/early": 2, "/right": 0, "/late": 2, "/none": 0}


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
    ("held", "closed", "reason"),
    [(3, 10, "3 of the 10 steps"), (10, 10, ""), (10, 12, "10 of the 12 steps"), (0, 10, "0 of the 10 steps")],
)
def test_a_bag_without_every_step_that_was_closed_is_not_complete(held, closed, reason):
    record = builder_of(range(held), closed).build()
    assert record.complete is (not reason)
    assert record.outcome.end is (EpisodeEnd.FAILED if reason else EpisodeEnd.COMPLETE)
    assert reason in record.outcome.reason
    assert (record.outcome.predicate_holds is None) is bool(reason)
    assert record.lost_steps == closed - held


def test_lost_steps_are_counted_up_to_the_last_one_where_the_bag_has_no_end():
    builder = RecordBuilder()
    for topic, step, message in EPISODE.messages():
        if topic not in {topics.OUTCOME, topics.EPISODE_END} and (topic.latched or step in {2, 3, 6}):
            builder.add(topic.name, message)
    record = builder.build()
    assert (record.steps, record.lost_steps, record.outcome) == (3, 4, None)


SHORT_RECORD = hand_made(
    crossing(),
    {EMV: Driven(NORTHBOUND, at_speed(10.0, 8.0, 6)), 2: Driven(EASTBOUND, at_speed(5.0, 4.0, 3), first_step=2)},
    lambda step: "rG" if step < 4 else "Gr",
)


def test_a_track_has_the_steps_times_and_speeds_of_one_actor():
    track = SHORT_RECORD.track(2)
    assert track.step.tolist() == [2, 3, 4]
    assert track.time_s == pytest.approx([0.1, 0.15, 0.2])
    assert track.speed_mps == pytest.approx([4.0] * 3)
    assert track.xy_m[:, 0] == pytest.approx(-110.0 + 5.0 + 0.2 * np.arange(3))
    assert set(track.actor_id.tolist()) == {2}
    with pytest.raises(InputError, match="actor_id: 999"):
        SHORT_RECORD.track(999)


def test_rows_are_sorted_by_actor_and_then_by_step():
    rows = SHORT_RECORD.rows
    assert rows.actor_id.tolist() == [EMV] * 6 + [2] * 3
    assert rows.step.tolist() == [0, 1, 2, 3, 4, 5, 2, 3, 4]
    assert SHORT_RECORD.rows_of(EMV).tolist() == [0, 1, 2, 3, 4, 5]
    assert SHORT_RECORD.rows_of(2).tolist() == [6, 7, 8]
    assert len(SHORT_RECORD.rows_of(7)) == 0
    assert rows.select(rows.step == 3).actor_id.tolist() == [EMV, 2]


def test_steps_and_signals():
    assert SHORT_RECORD.steps == 6
    assert SHORT_RECORD.signal_states("J") == {step: "rG" if step < 4 else "Gr" for step in range(6)}
    with pytest.raises(InputError, match=r"signal_id: 'K' .*one of J"):
        SHORT_RECORD.signal_states("K")
