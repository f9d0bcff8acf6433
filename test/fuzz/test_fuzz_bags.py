"""Bags and messages from strangers: any bytes give a record or one error of our own."""

import shutil
import struct
from contextlib import suppress

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from message_readers import READERS
from synthetic_episode import Scene, SyntheticEpisode

from siren_ros.base.numerics.units import time_ns_of_step
from siren_ros.data.interfaces import topics
from siren_ros.data.interfaces.messages import decode_cdr, step_of_cdr
from siren_ros.data.recording.bag_reader import read_episode
from siren_ros.data.recording.bag_writer import EpisodeBagWriter
from siren_ros.data.recording.recover import recover_bag
from siren_ros.errors import BagError, EpisodeError, InputError, SirenError
from siren_ros.scoring.judging.verify import verify_episode

fuzzed = settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
PERIODIC = (
    topics.CLOCK, topics.TRAFFIC, topics.EMV_COMMANDS, topics.ACTORS, topics.EVENTS, topics.TF,
    topics.GROUND_TRUTH,
)  # fmt: skip


@pytest.fixture(scope="module")
def bag(tmp_path_factory, write_bag):
    return write_bag(tmp_path_factory.mktemp("bags") / "bag", duration_s=0.3)


@pytest.fixture(scope="module")
def messages(typestore):
    """One encoded message of every topic of an episode."""
    episode = SyntheticEpisode(Scene(duration_s=0.3)).messages()
    return {
        topic.name: (topic, bytes(typestore.serialize_cdr(message, topic.type_name))) for topic, _, message in episode
    }


def damaged(data, changes, cut):
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
def test_a_damaged_bag_is_read_or_refused(bag, tmp_path_factory, changes, cut, in_metadata):
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
def test_a_step_is_read_from_any_bytes(data, topic):
    with suppress(EpisodeError):
        assert step_of_cdr(topic, data) >= 0


@settings(max_examples=300, deadline=None)
@given(changes=changes, cut=cuts, number=st.integers(0, 100))
def test_a_damaged_message_is_read_or_refused(messages, typestore, changes, cut, number):
    topic, cdr = messages[sorted(messages)[number % len(messages)]]
    with suppress(EpisodeError, InputError):
        READERS.get(topic.type_name, lambda read: read)(decode_cdr(typestore, topic, damaged(cdr, changes, cut)))


@pytest.mark.parametrize("claim", [2**32 - 1, 2**31, 10**9])
def test_lengths_that_a_message_claims_cost_nothing(messages, typestore, claim):
    topic, cdr = messages[topics.ACTORS.name]
    for place in range(4, len(cdr) - 3, 4):
        hostile = bytearray(cdr)
        struct.pack_into("<I", hostile, place, claim)
        with suppress(SirenError):
            decode_cdr(typestore, topic, bytes(hostile))


LIES = [
    *[(topics.EPISODE, "parameters", "[" * 100_000), (topics.EPISODE, "parameters", '{"predicate": 1}')],
    (topics.EPISODE, "parameters", '{"predicate": {"name": "../x", "thresholds": [1]}}'),
    *[(topics.EPISODE, "level", 99), (topics.EPISODE, "duration_s", float("nan"))],
    (topics.EPISODE, "duration_s", float("inf")),
    *[(topics.MAP, "data", '<!DOCTYPE net [<!ENTITY a "b">]><net>&a;</net>'), (topics.MAP, "data", "<net/>")],
    *[(topics.OUTCOME, "end", "never"), (topics.OUTCOME, "measures", "7"), (topics.ACTORS, "step", 2**63)],
    *[(topics.ACTORS, "x_m", np.zeros(0)), (topics.ACTORS, "x_m", np.full(6, np.nan))],
    (topics.ACTORS, "actor_id", np.full(6, 77, dtype=np.uint32)),
    (topics.TRAFFIC, "lane", np.full(6, 2**30, dtype=np.int32)),
    *[(topics.TRAFFIC, "route_offset", np.full(7, -5, dtype=np.int32)), (topics.EVENTS, "step", 2**64 - 1)],
]


@pytest.mark.parametrize(("lying", "field", "value"), LIES)
def test_a_bag_of_lies_is_judged_or_refused(lying, field, value, tmp_path, typestore):
    """A well-formed bag whose messages a stranger has changed."""
    writer = EpisodeBagWriter(
        tmp_path / "bag", typestore, [topic.name for topic in topics.CORE_TOPICS if topic.latched]
    )
    for topic, step, message in SyntheticEpisode(Scene(duration_s=0.3)).messages():
        if topic.name == lying.name:
            setattr(message, field, value)
        cdr = bytes(typestore.serialize_cdr(message, topic.type_name))
        writer.write(topic.name, topic.type_name, cdr, time_ns_of_step(step))
    bag = writer.finish().path
    with suppress(SirenError), np.errstate(all="ignore"):
        assert not verify_episode(read_episode(bag)).holds
