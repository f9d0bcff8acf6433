"""Bags and messages from strangers: any bytes give a record or one error of our own."""

import shutil
import struct
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from message_readers import READERS
from rosbags.typesys.store import Typestore
from synthetic_episode import Scene, SyntheticEpisode

from siren_ros.errors import BagError, EpisodeError, InputError, SirenError
from siren_ros.interfaces import topics
from siren_ros.interfaces.messages import decode_cdr, step_of_cdr
from siren_ros.judging.verify import verify_episode
from siren_ros.numerics.units import time_ns_of_step
from siren_ros.recording.bag_reader import read_episode
from siren_ros.recording.bag_writer import EpisodeBagWriter
from siren_ros.recording.recover import recover_bag

fuzzed = settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
PERIODIC = (
    topics.CLOCK,
    topics.TRAFFIC,
    topics.EMV_COMMANDS,
    topics.ACTORS,
    topics.EVENTS,
    topics.TF,
    topics.GROUND_TRUTH,
)


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory, write_bag: Callable[..., Path]) -> Path:
    return write_bag(tmp_path_factory.mktemp("bags") / "bag", duration_s=0.3)


@pytest.fixture(scope="module")
def messages(typestore: Typestore) -> dict[str, tuple[topics.Topic, bytes]]:
    """One encoded message of every topic of an episode."""
    made = SyntheticEpisode(Scene(duration_s=0.3)).messages()
    return {topic.name: (topic, bytes(typestore.serialize_cdr(message, topic.type_name))) for topic, _, message in made}


def damaged(data: bytes, changes: list[tuple[float, int]], cut: float) -> bytes:
    """The data with bytes replaced at relative places, and shortened."""
    out = bytearray(data)
    for share, value in changes:
        if out:
            out[min(int(share * len(out)), len(out) - 1)] = value
    return bytes(out[: int(len(out) * cut)])


changes = st.lists(st.tuples(st.floats(0.0, 1.0), st.integers(0, 255)), max_size=5)
cuts = st.one_of(st.just(1.0), st.floats(0.0, 1.0))


@fuzzed
@given(changes=changes, cut=cuts, in_metadata=st.booleans())
def test_a_damaged_bag_is_read_or_refused(
    bag: Path, tmp_path_factory: pytest.TempPathFactory, changes: list[tuple[float, int]], cut: float, in_metadata: bool
) -> None:
    copy = tmp_path_factory.mktemp("copy") / "bag"
    shutil.copytree(bag, copy)
    file = copy / ("metadata.yaml" if in_metadata else "bag_0.mcap")
    file.write_bytes(damaged(file.read_bytes(), changes, cut))
    with suppress(BagError, EpisodeError):  # the latter: a record that contradicts itself
        verify_episode(read_episode(copy))
    with suppress(BagError):
        recovered = recover_bag(copy).path
        with suppress(BagError):
            read_episode(recovered)
    shutil.rmtree(copy.parent)


@fuzzed
@given(data=st.binary(max_size=200), topic=st.sampled_from(PERIODIC))
def test_a_step_is_read_from_any_bytes(data: bytes, topic: topics.Topic) -> None:
    with suppress(EpisodeError):
        assert step_of_cdr(topic, data) >= 0


@settings(max_examples=300, deadline=None)
@given(changes=changes, cut=cuts, number=st.integers(0, 100))
def test_a_damaged_message_is_read_or_refused(
    messages: dict[str, tuple[topics.Topic, bytes]],
    typestore: Typestore,
    changes: list[tuple[float, int]],
    cut: float,
    number: int,
) -> None:
    topic, cdr = messages[sorted(messages)[number % len(messages)]]
    with suppress(EpisodeError, InputError):
        message = decode_cdr(typestore, topic, damaged(cdr, changes, cut))
        READERS.get(topic.type_name, lambda read: read)(message)


@pytest.mark.parametrize("claim", [2**32 - 1, 2**31, 10**9])
def test_lengths_that_a_message_claims_cost_nothing(
    messages: dict[str, tuple[topics.Topic, bytes]], typestore: Typestore, claim: int
) -> None:
    topic, cdr = messages[topics.ACTORS.name]
    for place in range(4, len(cdr) - 3, 4):
        hostile = bytearray(cdr)
        struct.pack_into("<I", hostile, place, claim)
        with suppress(SirenError):
            decode_cdr(typestore, topic, bytes(hostile))


def with_message(folder: Path, typestore: Typestore, change: Callable[[str, int, Any], None]) -> Path:
    """A well-formed bag whose messages a stranger has changed."""
    episode = SyntheticEpisode(Scene(duration_s=0.3))
    writer = EpisodeBagWriter(folder / "bag", typestore, [topic.name for topic in topics.CORE_TOPICS if topic.latched])
    for topic, step, message in episode.messages():
        change(topic.name, step, message)
        cdr = bytes(typestore.serialize_cdr(message, topic.type_name))
        writer.write(topic.name, topic.type_name, cdr, time_ns_of_step(step))
    return writer.finish().path


def _set(name: str, field: str, value: Any) -> Callable[[str, int, Any], None]:
    def change(topic: str, _step: int, message: Any) -> None:
        if topic == name:
            setattr(message, field, value)

    return change


@pytest.mark.parametrize(
    "change",
    [
        _set(topics.EPISODE.name, "parameters", "[" * 100_000),
        _set(topics.EPISODE.name, "parameters", '{"predicate": 1}'),
        _set(topics.EPISODE.name, "parameters", '{"predicate": {"name": "../x", "thresholds": [1]}}'),
        _set(topics.EPISODE.name, "level", 99),
        _set(topics.EPISODE.name, "duration_s", float("nan")),
        _set(topics.EPISODE.name, "duration_s", float("inf")),
        _set(topics.MAP.name, "data", '<!DOCTYPE net [<!ENTITY a "b">]><net>&a;</net>'),
        _set(topics.MAP.name, "data", "<net/>"),
        _set(topics.OUTCOME.name, "end", "never"),
        _set(topics.OUTCOME.name, "measures", "7"),
        _set(topics.ACTORS.name, "step", 2**63),
        _set(topics.ACTORS.name, "x_m", np.zeros(0)),
        _set(topics.ACTORS.name, "x_m", np.full(6, np.nan)),
        _set(topics.ACTORS.name, "actor_id", np.full(6, 77, dtype=np.uint32)),
        _set(topics.TRAFFIC.name, "lane", np.full(6, 2**30, dtype=np.int32)),
        _set(topics.TRAFFIC.name, "route_offset", np.full(7, -5, dtype=np.int32)),
        _set(topics.EVENTS.name, "step", 2**64 - 1),
    ],
)
def test_a_bag_of_lies_is_judged_or_refused(
    change: Callable[[str, int, Any], None], tmp_path: Path, typestore: Typestore
) -> None:
    bag = with_message(tmp_path, typestore, change)
    with suppress(SirenError), np.errstate(all="ignore"):
        verification = verify_episode(read_episode(bag))
        assert not verification.holds


def test_the_fixture_is_sound(bag: Path) -> None:
    record = read_episode(bag)
    assert (record.steps, record.complete) == (6, True)
