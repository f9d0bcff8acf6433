"""A running episode's data, from messages in the order in which they come."""

from collections.abc import Iterable
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from episode_page.unpacked import unpacked
from synthetic_episode import Scene, SyntheticEpisode

from siren_ros.base.numerics.units import STEP_S
from siren_ros.data.interfaces import topics
from siren_ros.data.interfaces.conversions import to_actor_description, to_traffic_state
from siren_ros.data.interfaces.topics import Topic
from siren_ros.data.recording.episode_record import EpisodeRecord
from siren_ros.data.recording.record_builder import RecordBuilder
from siren_ros.reports.episode_page.live import LIVE_TOPICS, LiveEpisode, Place
from siren_ros.running.ros.transport.copies import StepCopies, happens
from siren_ros.simulation.world.traffic_state import SignalState

Messages = list[tuple[Topic, int, Any]]


@pytest.fixture(scope="module")
def messages() -> Messages:
    """Three seconds, at the end of which the outcome is known."""
    return [row for row in SyntheticEpisode(Scene(duration_s=3.0)).messages() if row[0].name in LIVE_TOPICS]


@pytest.fixture(scope="module")
def record(messages: Messages) -> EpisodeRecord:
    return record_of(messages)


def record_of(messages: Messages) -> EpisodeRecord:
    builder = RecordBuilder()
    for topic, _, message in messages:
        builder.add(topic.name, message)
    return builder.build()


def rows_of(parts: Iterable[bytes]) -> list[tuple[int, int, float, float]]:
    """Step, actor and place of each row in files that follow one another."""
    rows = []
    for part in parts:
        head, columns = unpacked(part)
        x_m, y_m, row = columns["motion.x_m"], columns["motion.y_m"], 0
        for actor in head["actors"]:
            for frame in range(actor["first"], actor["first"] + actor["frames"]):
                rows.append((int(columns["frame.step"][frame]), actor["id"], x_m[row], y_m[row]))
                row += 1
    return sorted(rows)


def told(messages: Messages, every: int) -> tuple[list[bytes], LiveEpisode]:
    """What a reader gets who asks after each so many messages."""
    episode, place, parts = LiveEpisode(), Place(), []
    for count, (topic, _, message) in enumerate(messages, 1):
        assert episode.belongs(topic.name)
        episode.add(topic.name, message)
        step, judged = episode.progress
        if count % every == 0 and (step > place.step or (judged and not place.judged)):
            part, place = episode.since(place)
            parts.append(part)
    return parts, episode


@pytest.mark.parametrize("every", [1, 7, 50])
def test_the_parts_together_are_the_record(messages: Messages, record: EpisodeRecord, every: int) -> None:
    parts, episode = told(messages, every)
    rest, place = episode.since(Place(30)) if every == 50 else (b"", Place())
    rows = rows_of(parts)
    last = max(step for step, *_ in rows)
    wanted = sorted(
        row for row in zip(record.rows.step, record.rows.actor_id, *record.rows.xy_m.T, strict=True) if row[0] <= last
    )
    assert [row[:2] for row in rows] == [(int(step), int(actor)) for step, actor, *_ in wanted]
    assert np.abs(np.array(rows)[:, 2:] - np.array(wanted)[:, 2:]).max() <= 0.0005 + 1e-9
    assert last >= record.steps - 1 - every
    if every == 50:
        assert min(step for step, *_ in rows_of([rest])) == 31
        assert place.step == record.steps - 1


def test_events_and_signals_come_once_and_the_outcome_at_the_end(messages: Messages, record: EpisodeRecord) -> None:
    heads = [unpacked(part)[0] for part in told(messages, 1)[0]]
    assert [event[0] for head in heads for event in head["events"]] == [event.step for event in record.events]
    assert heads[0]["verdict"] is None
    assert heads[0]["ended"] == "not yet"
    assert all("ended" not in head for head in heads[1:-1])
    assert record.outcome is not None
    assert heads[-1]["ended"] == record.outcome.end.value
    assert "columns" in heads[-1]


def test_a_step_is_shown_when_all_its_topics_are_there(messages: Messages) -> None:
    episode = LiveEpisode()
    for topic, step, message in messages:
        if topic != topics.EVENTS or step < 5:
            episode.add(topic.name, message)
    assert episode.progress[0] == 4


def test_nothing_is_shown_before_map_and_description(messages: Messages) -> None:
    for lacking in (topics.MAP, topics.EPISODE):
        episode = LiveEpisode()
        for topic, _, message in messages:
            if topic != lacking:
                episode.add(topic.name, message)
        assert episode.progress[0] == -1


def test_the_end_of_a_whole_episode_is_told_by_itself(messages: Messages, record: EpisodeRecord) -> None:
    episode = LiveEpisode()
    for topic, _, message in messages:
        episode.add(topic.name, message)
    begin, place = episode.since(Place())
    assert unpacked(begin)[0]["ended"] == "not yet"
    assert "seen" not in [name for name, _ in unpacked(begin)[0]["facts"]]
    assert not place.judged
    end, place = episode.since(place)
    assert unpacked(end)[0]["ended"] == record.outcome.end.value
    assert place.judged
    assert rows_of([end]) == []


def thinned(messages: Messages, period_s: float, step_s: float) -> Messages:
    """What a viewer hears of an episode whose steps take so much wall time."""
    heard: Messages = []
    now_s = 0.0
    copies = StepCopies(period_s, lambda: now_s)
    before: dict[str, Any] = {}
    for row in messages:
        topic, step, message = row
        now_s = step * step_s
        if topic.name not in topics.OBSERVED:
            if topic == topics.OUTCOME:
                copies.send_held()
            heard.append(row)
            continue
        content = (step, 0, message.events) if topic == topics.EVENTS else message
        happening = happens(topic.name, content, before.get(topic.name))
        before[topic.name] = content
        copies.take(step, happening, lambda row=row: heard.append(row))
    return heard


@pytest.mark.parametrize("every", [1, 11])
def test_of_a_fast_episode_steps_are_left_out_and_nothing_that_happens(every: int) -> None:
    """Eight seconds, of which the viewer hears about every twelfth step; signals change at a step of their own."""
    messages = [row for row in SyntheticEpisode(Scene(duration_s=8.0)).messages() if row[0].name in LIVE_TOPICS]
    messages = [(topic, step, with_signal(topic, step, message)) for topic, step, message in messages]
    record = record_of(messages)
    heard = thinned(messages, STEP_S, STEP_S / 12.0)
    steps = [step for topic, step, _ in heard if topic == topics.ACTORS]
    parts, episode = told(heard, every)
    parts.append(episode.since(Place(max(step for step, *_ in rows_of(parts))))[0])
    heads = [unpacked(part)[0] for part in parts]
    assert len(steps) < record.steps / 5
    rows = record.rows.select(np.isin(record.rows.step, steps))
    found = np.array(rows_of(parts))
    order = np.lexsort((rows.actor_id, rows.step))
    assert found[:, 0].tolist() == rows.step[order].tolist()
    assert found[:, 1].tolist() == rows.actor_id[order].tolist()
    assert np.abs(found[:, 2:] - rows.xy_m[order]).max() <= 0.0005 + 1e-9
    told_events = [(event[0], event[1], event[2]) for head in heads for event in head["events"]]
    assert told_events == [(event.step, event.kind.value, event.actor_id) for event in record.events]
    assert len(told_events) > 5
    changes = [change for head in heads for change in head["signals"].get("J", ())]
    assert [change for before, change in pairwise([[-1, ""], *changes]) if change[1] != before[1]] == [
        [0, "r"],
        [47, "G"],
    ]
    assert heads[-1]["ended"] == "complete"
    assert steps[-1] == record.steps - 1


def with_signal(topic: Topic, step: int, message: Any) -> Any:
    """The message, with a signal that changes at step 47."""
    if topic != topics.TRAFFIC:
        return message
    template = to_traffic_state(replace(SyntheticEpisode().traffic(0), signals=(SignalState("J", "r"),)))
    return replace(message, signals=[replace(template.signals[0], state="r" if step < 47 else "G")])


def late(messages: Messages, from_step: int) -> Messages:
    """What somebody hears who comes later: latched messages, and the steps from then on."""
    return [row for row in messages if row[0].latched or row[1] >= from_step]


def test_who_comes_late_needs_the_roster(messages: Messages, record: EpisodeRecord) -> None:
    episode = LiveEpisode()
    for topic, _, message in late(messages, 20):
        episode.add(topic.name, message)
    assert episode.progress[0] == -1
    traffic = next(message for topic, _, message in messages if topic == topics.TRAFFIC)
    everybody = [to_actor_description(actor) for actor in record.actors.values()]
    episode.add(topics.ROSTER.name, replace(traffic, spawned=everybody))
    begin, place = episode.since(Place())
    rows = rows_of([begin])
    assert ["seen", "from 1.00 s on; events before are not known"] in unpacked(begin)[0]["facts"]
    assert unpacked(episode.since(place)[0])[0]["ended"] == "complete"
    assert {step for step, *_ in rows} == set(range(20, record.steps))
    assert {actor for _, actor, *_ in rows} == set(record.rows.actor_id[record.rows.step >= 20].tolist())


def test_actors_of_whom_nothing_was_said_are_left_out(messages: Messages) -> None:
    episode = LiveEpisode()
    for topic, _, message in messages:
        spawned = getattr(message, "spawned", None)
        kept = message if spawned is None else replace(message, spawned=[one for one in spawned if one.actor_id != 2])
        episode.add(topic.name, kept)
    assert 2 not in {actor for _, actor, *_ in rows_of([episode.since(Place())[0]])}


def test_the_next_episode_begins_with_its_description_or_map(messages: Messages) -> None:
    episode = LiveEpisode()
    assert all(episode.belongs(topic) for topic in LIVE_TOPICS)
    for topic, _, message in messages:
        episode.add(topic.name, message)
    assert [topic for topic in LIVE_TOPICS if not episode.belongs(topic)] == [topics.EPISODE.name, topics.MAP.name]
