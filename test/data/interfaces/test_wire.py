"""Messages as CDR bytes."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from siren_ros.data.interfaces import wire
from siren_ros.data.interfaces.boxes import Marker, MarkerShape, SpaceBoxes, to_boxes, to_markers
from siren_ros.data.interfaces.conversions import (
    Phase,
    StepReport,
    from_actor_states,
    from_step_done,
    to_actor_states,
    to_step_done,
)
from siren_ros.data.interfaces.measurements import Transform, to_tf
from siren_ros.data.interfaces.messages import encode_cdr
from siren_ros.data.interfaces.topics import ACTORS, BOXES, CLOCK, MARKERS, STEP_DONE, TF
from siren_ros.data.interfaces.wire import CdrWriter, Layout, stamped, text
from siren_ros.simulation.world.actors import ACTOR_STATE_DTYPES, ActorStates

NAMES = st.text("abcé_/", max_size=9)
"""Names of every length shift what follows them against the alignment."""


@given(NAMES, st.sampled_from(Phase), NAMES, st.integers(0, 2**64 - 1), st.floats(allow_nan=False))
def test_a_report_comes_back(round_trip, name, phase, error, step, busy_s):
    report = StepReport(step, name, phase, error, busy_s)
    assert from_step_done(round_trip(to_step_done(report), STEP_DONE.type_name)) == report


@given(st.lists(st.tuples(NAMES, NAMES), max_size=4))
def test_frames_with_names_of_any_length_are_the_stores_bytes(round_trip, names):
    transforms = [Transform(parent, child, (1.0, 2.0, 3.0), (0.0, 0.0, 0.6, 0.8)) for parent, child in names]
    message = round_trip(to_tf(27, transforms), TF.type_name)
    assert [(item.header.frame_id, item.child_frame_id) for item in message.transforms] == names


@given(NAMES, st.lists(st.tuples(NAMES, NAMES), max_size=4))
def test_boxes_with_names_of_any_length_are_the_stores_bytes(round_trip, frame, names):
    kinds, ids = tuple(kind for kind, _ in names), tuple(box_id for _, box_id in names)
    rows = np.full((len(names), 3), 2.0)
    message = round_trip(
        to_boxes(SpaceBoxes(4, frame, kinds, rows[:, 0], rows, rows, rows[:, 1], ids)), BOXES.type_name
    )
    assert [item.results[0].hypothesis.class_id for item in message.detections] == list(kinds)
    assert all(item.bbox.center.position.z == item.bbox.size.z == 2.0 for item in message.detections)


@given(st.lists(st.tuples(NAMES, NAMES), max_size=4))
def test_markers_with_texts_of_any_length_are_the_stores_bytes(round_trip, names):
    markers = [
        Marker(space, 7, MarkerShape.TEXT, (1.0, 2.0, 3.0), 0.5, (4.0, 5.0, 6.0), (0.25, 0.5, 0.75, 1.0), shown)
        for space, shown in names
    ]
    message = round_trip(to_markers(8, markers), MARKERS.type_name)
    assert [(item.ns, item.text, item.scale.z, item.color.b) for item in message.markers] == [
        (space, shown, 6.0, 0.75) for space, shown in names
    ]


@pytest.mark.parametrize("offset", range(9))
def test_fields_lie_at_multiples_of_their_size(offset):
    packed = Layout("B d B i s B").pack(offset, 1, 0.5, 2, 3, text("ab"), 4)
    first_number = -(offset + 1) % 8 + 1
    assert (packed[0], packed[first_number : first_number + 8]) == (1, b"\0\0\0\0\0\0\xe0?")
    word = first_number + 8 + 4  # the byte behind the number, and three of padding
    assert packed[word:] == b"\3\0\0\0" + b"\3\0\0\0ab\0" + b"\4"


def test_a_message_fills_whole_words_and_finished_bytes_stay(typestore):
    writer = CdrWriter()
    writer.put(Layout("B"), 9)
    assert writer.cdr() == b"\0\1\0\0" + b"\x09\0\0\0"
    assert encode_cdr(typestore, CLOCK, writer.cdr()) == writer.cdr()
    assert stamped(27, "map") == (1, 350_000_000, b"\4\0\0\0map\0")


def states_at(step: int) -> ActorStates:
    return ActorStates(step, **{name: np.ones(2, dtype) for name, dtype in ACTOR_STATE_DTYPES.items()})


def test_what_was_sent_is_read_without_a_conversion():
    states = states_at(3)
    cdr = wire.encode_content(ACTORS, 3, states, to_actor_states)
    assert cdr == wire.encode(ACTORS, to_actor_states(states))
    message = wire.decode(ACTORS, bytes(bytearray(cdr)))  # as it comes from the middleware
    assert wire.step_of_message(ACTORS, message) == 3
    assert wire.content(from_actor_states, message) is states


def test_what_others_send_is_decoded():
    wire.encode_content(ACTORS, 4, states_at(4), to_actor_states)
    message = wire.decode(ACTORS, wire.encode(ACTORS, to_actor_states(states_at(5))))
    assert wire.step_of_message(ACTORS, message) == 5
    read = wire.content(from_actor_states, message)
    assert read is wire.content(from_actor_states, message)
    assert (read.step, read.x_m.tolist()) == (5, [1.0, 1.0])


def test_reports_of_all_nodes_are_known_together_and_old_ones_are_forgotten():
    reports = [StepReport(7, f"node_{number}", Phase.STEP) for number in range(wire.KEPT + 1)]
    sent = [wire.encode_content(STEP_DONE, 7, report, to_step_done) for report in reports]
    read = [wire.content(from_step_done, wire.decode(STEP_DONE, cdr)) for cdr in sent]
    assert read == reports
    assert [value is report for value, report in zip(read, reports, strict=True)] == [False] + [True] * wire.KEPT
