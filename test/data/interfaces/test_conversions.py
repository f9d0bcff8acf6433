"""Every pair of conversions is an exact round trip, for live messages and for messages in bags."""

import dataclasses
import math
import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from message_readers import READERS
from rclpy.serialization import deserialize_message
from repository import REPOSITORY

from siren_ros.base.numerics.geometry import Polyline
from siren_ros.data.interfaces import boxes, conversions
from siren_ros.data.interfaces.conversions import EpisodeClosing, Phase, StepReport
from siren_ros.data.interfaces.messages import plain_message, stamp, typestore
from siren_ros.errors import EpisodeError, InputError
from siren_ros.running.ros.transport.endpoints import message_class
from siren_ros.simulation.scenario.episode import EpisodeDescription, EpisodeEnd, EpisodeOutcome
from siren_ros.simulation.scenario.paper import EmergencyLevel
from siren_ros.simulation.world.actors import (
    ACTOR_STATE_DTYPES,
    TRAFFIC_STATE_DTYPES,
    ActorClass,
    ActorDescription,
    ActorStates,
    EmvAdvice,
    Event,
    EventKind,
    SignalState,
    TrafficState,
)
from siren_ros.simulation.world.carrier import GROUND_TRUTH_DTYPES, GroundTruth, PredictedPaths
from siren_ros.simulation.world.commands import COMMAND_DTYPES, AvControl, VehicleCommands

STORE = typestore()

numbers = st.floats(allow_nan=False, allow_infinity=False)
ids = st.integers(0, 2**32 - 1)
names = st.text(st.characters(codec="utf-8", exclude_characters="\0"), max_size=12)
details = st.dictionaries(names, st.one_of(st.integers(-(2**40), 2**40), numbers, names), max_size=3)
events = st.builds(Event, st.integers(0, 10**6), st.sampled_from(EventKind), ids, ids, numbers, numbers, details)
actors = st.builds(
    ActorDescription, ids, names, st.sampled_from(ActorClass), numbers, numbers, numbers,
    st.tuples(*[st.integers(0, 255)] * 3), st.booleans(),
)  # fmt: skip


def arrays(dtypes, seed, count):
    rng = np.random.default_rng(seed)
    return {
        name: rng.standard_normal(count) * 100
        if dtype is np.float64
        else rng.integers(0, 2 if dtype is np.bool_ else 200, count).astype(dtype)
        for name, dtype in dtypes.items()
    }


@st.composite
def tables(draw):
    seed, count, step = draw(st.integers(0, 2**32)), draw(st.integers(0, 5)), draw(st.integers(0, 2000))
    some_events = tuple(draw(st.lists(events, max_size=2)))
    kind = draw(st.integers(0, 3))
    if kind == 0:
        return ActorStates(step=step, **arrays(ACTOR_STATE_DTYPES, seed, count))
    if kind == 1:
        return VehicleCommands(step=step, source="x", events=some_events, **arrays(COMMAND_DTYPES, seed, count))
    if kind == 2:
        return GroundTruth(step=step, carrier_id=1, **arrays(GROUND_TRUTH_DTYPES, seed, count))
    return TrafficState(
        step=step, spawned=tuple(draw(st.lists(actors, max_size=2))),
        emvs=(EmvAdvice(1, -1, 7, 12.5, 3.25, 4),) * count, signals=(SignalState("J1", "GGrr"),) * count,
        events=some_events, **arrays(TRAFFIC_STATE_DTYPES, seed, count),
    )  # fmt: skip


values = st.one_of(
    tables(),
    events,
    actors,
    st.builds(SignalState, names, names),
    st.builds(StepReport, st.integers(0, 10**6), names, st.sampled_from(Phase), names, numbers),
    st.builds(EpisodeClosing, st.integers(0, 10**6), st.sampled_from(EpisodeEnd), names),
    st.builds(
        EpisodeDescription,
        template=names,
        level=st.sampled_from(EmergencyLevel),
        seed=st.integers(0, 2**31 - 1),
        map_name=names,
        map_sha256=names,
        duration_s=numbers,
        sensor_suite=names,
        preset=names,
        emv_ids=st.lists(ids, max_size=3).map(tuple),
        parameters=details,
        versions=st.dictionaries(names, names, max_size=2),
        site=details,
    ),
    st.builds(
        EpisodeOutcome,
        st.sampled_from(EpisodeEnd),
        names,
        st.integers(0, 10**6),
        st.sampled_from([True, False, None]),
        details,
    ),
)

OTHER_NAMES = {StepReport: "StepDone", EpisodeClosing: "EpisodeEnd"}
PAIRS = {SignalState: ("siren_msgs/msg/SignalState", plain_message)}
for module, *classes in (
    (conversions, ActorStates, VehicleCommands, TrafficState, Event, ActorDescription),
    (boxes, GroundTruth),
    (conversions, StepReport, EpisodeClosing, EpisodeDescription, EpisodeOutcome),
):
    for cls in classes:
        name = OTHER_NAMES.get(cls, cls.__name__)
        convert = getattr(module, "to" + re.sub("(?=[A-Z])", "_", name).lower())
        PAIRS[cls] = (f"siren_msgs/msg/{name}", convert)


def same(left, right):
    for field in dataclasses.fields(left):
        a, b = getattr(left, field.name), getattr(right, field.name)
        equal = a.dtype == b.dtype and np.array_equal(a, b) if isinstance(a, np.ndarray) else a == b
        if not equal:
            return False
    return True


@settings(deadline=None)
@given(values)
def test_round_trip(value):
    type_name, convert = PAIRS[type(value)]
    read = READERS[type_name]
    message = convert(value)
    finished = isinstance(message, bytes)
    assert finished or same(read(message), value)
    cdr = message if finished else bytes(STORE.serialize_cdr(message, type_name))
    assert same(read(STORE.deserialize_cdr(cdr, type_name)), value)
    as_any_ros_program_reads_it = deserialize_message(cdr, message_class(type_name))
    assert same(read(as_any_ros_program_reads_it), value)


def test_every_own_message_has_a_reader():
    folder = REPOSITORY / "msg_defs" / "msg"
    assert {f"siren_msgs/msg/{path.stem}" for path in folder.glob("*.msg")} == set(READERS)


@given(st.integers(0, 10**6), st.integers(0, 2**64 - 1), st.lists(events, max_size=3).map(tuple))
def test_the_events_of_a_step_keep_its_state_hash(round_trip, step, state_hash, some):
    message = round_trip(conversions.to_events(step, state_hash, some))
    assert conversions.from_events(message) == (step, state_hash, some)


@pytest.mark.parametrize(
    ("field", "text", "words"),
    [
        *[("detail", text, None) for text in ("", "{", "[1]", "null", "[" * 100_000, "1" * 10_000)],
        ("kind", "resurrection", "resurrection"),
    ],
)
def test_text_that_is_no_json_object_and_an_unknown_code_are_input_errors(field, text, words):
    message = conversions.to_event(Event(0, EventKind.COLLISION, 1))
    setattr(message, field, text)
    with pytest.raises(InputError, match=words):
        conversions.from_event(message)


def stamp_ns(message):
    """The stamp of a message, with or without a header."""
    stamp_ = message.header.stamp if hasattr(message, "header") else message.stamp
    return int(stamp_.sec) * 10**9 + int(stamp_.nanosec)


@given(value=values)
def test_a_stamp_is_the_simulated_time_of_its_step(value):
    message = PAIRS[type(value)][1](value)
    if isinstance(value, EpisodeClosing | EpisodeOutcome):
        assert stamp_ns(message) == max(value.steps - 1, 0) * 50_000_000
    elif isinstance(value, EpisodeDescription):
        assert stamp_ns(message) == 0
    elif hasattr(message, "stamp") or hasattr(message, "header"):
        assert stamp_ns(message) == value.step * 50_000_000


pedals = st.tuples(st.floats(0.0, 1.0), st.booleans()).map(lambda it: (it[0], 0.0) if it[1] else (0.0, it[0]))
controls = st.builds(
    lambda step, pressed, steer_rad, lights: AvControl(step, *pressed, steer_rad, lights),
    st.integers(0, 10**6), pedals, st.floats(-1.0, 1.0), st.sampled_from([0, 2, 4]),
)  # fmt: skip


@given(controls)
def test_controls_come_back_and_are_allowed(round_trip, control):
    control.check()
    assert conversions.from_av_control(round_trip(conversions.to_av_control(control))) == control


@pytest.mark.parametrize(
    ("step", "sec", "nanosec", "error", "words"),
    [
        (4, 0, 150_000_000, EpisodeError, r"the stamp 0.15 s is not the time of step 4"),
        (40, 2, 1, EpisodeError, r"the stamp 2.000000001 s is not the time of step 40"),
        (40, 1, 10**9, InputError, r"stamp: '1 s and 1000000000 ns' cannot be used"),
    ],
    ids=["of another step", "off by a nanosecond", "a second of nanoseconds, with the right sum"],
)
def test_another_stamp_is_refused(step, sec, nanosec, error, words):
    message = conversions.to_av_control(AvControl(step))
    message.stamp.sec, message.stamp.nanosec = sec, nanosec
    with pytest.raises(error, match=words):
        conversions.from_av_control(message)


def test_a_way_comes_back_and_its_poses_look_along_it(round_trip):
    way = Polyline.through([(0.0, 0.0), (10.0, 0.0), (10.0, 5.0)])
    message = round_trip(conversions.to_path(way))
    assert np.array_equal(conversions.from_path(message).points, way.points)
    turned = [2.0 * math.atan2(pose.pose.orientation.z, pose.pose.orientation.w) for pose in message.poses]
    assert turned == pytest.approx([0.0, math.pi / 2, math.pi / 2])
    assert {pose.pose.position.z for pose in message.poses} == {0.0}
    assert {pose.header.frame_id for pose in message.poses} == {"map"}


def paths_of(seed, paths, points, step=40):
    rng = np.random.default_rng(seed)
    ids = rng.integers(1, 2**32 - 1, paths).astype(np.uint32)
    return PredictedPaths(step, ids, rng.random(paths), rng.normal(scale=1e3, size=(paths, points, 2)))


@given(seed=st.integers(0, 1000), paths=st.integers(1, 7), points=st.sampled_from([25, 30, 60]))
def test_paths_come_back_to_the_last_bit(round_trip, seed, paths, points):
    given_paths = paths_of(seed, paths, points)
    back = conversions.from_predicted_paths(round_trip(conversions.to_predicted_paths(given_paths)))
    assert back.step == 40
    for name in ("actor_id", "probability", "xy_m"):
        assert np.array_equal(getattr(back, name), getattr(given_paths, name))
    assert back.actor_id.dtype == np.uint32
    nobody = conversions.from_predicted_paths(round_trip(conversions.to_predicted_paths(paths_of(0, 0, 25))))
    assert (len(nobody), nobody.xy_m.shape) == (0, (0, 0, 2))


def test_lengths_and_stamps_that_do_not_fit_are_refused():
    for field, reason in (
        ("probability", r"paths of step 40 with 3 actor_id, 2 probability, 75 x_m, 75 y_m"),
        ("y_m", "75 x_m, 74 y_m"),
        ("actor_id", "2 actor_id, 3 probability"),
        ("stamp", r"the stamp 0 s is not the time of step 40"),
    ):
        message = conversions.to_predicted_paths(paths_of(0, 3, 25))
        setattr(message, field, stamp(0) if field == "stamp" else getattr(message, field)[:-1])
        with pytest.raises(EpisodeError, match=reason):
            conversions.from_predicted_paths(message)
