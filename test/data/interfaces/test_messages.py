"""Message types of the installation, and what all conversions build on."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from repository import REPOSITORY

from siren_ros.data.interfaces import measurements, messages, topics
from siren_ros.data.interfaces.boxes import (
    boxes_of,
    to_boxes,
    to_camera_truth,
    to_image_boxes,
    to_markers,
    vehicle_markers,
)
from siren_ros.data.interfaces.measurements import Transform, quaternion_of_yaw, to_tf
from siren_ros.data.interfaces.messages import (
    decode_cdr,
    encode_cdr,
    make_message,
    stamp,
    step_of_cdr,
)
from siren_ros.data.interfaces.wire import step_of_message
from siren_ros.errors import EpisodeError, InputError
from siren_ros.sensing.lidar.lidar import LIDAR_POINT_DTYPE
from siren_ros.simulation.world.actors import ACTOR_STATE_DTYPES, ActorClass, ActorDescription, ActorStates
from siren_ros.simulation.world.carrier import (
    CAMERA_TRUTH_DTYPES,
    GROUND_TRUTH_DTYPES,
    CameraIntrinsics,
    CameraTruth,
    GnssFix,
    GroundTruth,
)


@pytest.mark.parametrize("time_ns", [0, 50_000_000, 1_000_000_000, 2_999_999_999])
def test_a_stamp_comes_back(time_ns):
    message = messages.stamp(time_ns)
    assert messages.time_ns_of(message) == time_ns
    assert 0 <= message.nanosec < 10**9


def test_the_installed_definitions_are_those_of_the_repository():
    sources = {
        "siren_msgs": REPOSITORY / "msg_defs" / "msg",
        "vision_msgs": REPOSITORY / "tools" / "environment" / "interfaces" / "vision_msgs" / "msg",
    }
    written = messages.load_typestore(sources)
    names = [f"{package}/msg/{path.stem}" for package, folder in sources.items() for path in folder.glob("*.msg")]
    assert names
    for name in names:
        assert written.generate_msgdef(name) == messages.typestore().generate_msgdef(name)


def test_a_package_is_looked_for_in_every_prefix(tmp_path, monkeypatch):
    folder = tmp_path / "b" / "share" / "some_msgs" / "msg"
    folder.mkdir(parents=True)
    monkeypatch.setenv("AMENT_PREFIX_PATH", f"{tmp_path / 'a'}:{tmp_path / 'b'}")
    assert messages.message_folder("some_msgs") == folder
    with pytest.raises(InputError, match="other_msgs"):
        messages.message_folder("other_msgs")


def test_arrays_are_read_only_copies():
    values = np.arange(3, dtype=np.uint32)
    message = messages.make_message("std_msgs/msg/UInt32MultiArray", layout=None, data=values)
    arrays = messages.as_arrays(message, {"data": np.float64})
    values[0] = 7
    assert arrays["data"].tolist() == [0.0, 1.0, 2.0]
    assert not arrays["data"].flags.writeable
    columns = messages.sequence(np.arange(6).reshape(3, 2)[:, 0])
    assert columns.flags.c_contiguous, "in one piece"
    assert columns.tolist() == [0, 2, 4]


frames = st.text("abcé_/", max_size=9)
"""Names of every length shift what follows them against the alignment."""


def assert_plain(store, topic, message):
    """The bytes are the store's own, filled up to whole words, and say the same."""
    cdr = encode_cdr(store, topic, message)
    plain = bytes(store.serialize_cdr(message, topic.type_name))
    assert (len(cdr) % 4, cdr) == (0, plain + bytes(len(cdr) - len(plain)))
    assert len(cdr) - len(plain) < 4
    assert bytes(decode_cdr(store, topic, cdr).data) == bytes(message.data)


@given(frames, st.integers(0, 5), st.integers(0, 1000))
def test_points_are_encoded_as_the_store_would(typestore, frame, points, step):
    message = measurements.to_point_cloud(step, frame, np.frombuffer(bytes(range(24)) * points, LIDAR_POINT_DTYPE))
    assert_plain(typestore, topics.LIDAR, message)
    assert step_of_cdr(topics.LIDAR, encode_cdr(typestore, topics.LIDAR, message)) == step


@given(frames, st.integers(1, 5), st.integers(1, 5))
def test_pictures_are_encoded_as_the_store_would(typestore, frame, rows, columns):
    rgb = np.arange(rows * columns * 3, dtype=np.uint8).reshape(rows, columns, 3)
    assert_plain(typestore, topics.IMAGE, measurements.to_image(3, frame, rgb))
    assert_plain(typestore, topics.IMAGE, measurements.to_image(3, frame, rgb[..., 0].astype(np.float32)))


@given(frames, st.binary(max_size=9))
def test_jpegs_are_encoded_as_the_store_would(typestore, frame, jpeg):
    assert_plain(typestore, topics.IMAGE_COMPRESSED, measurements.to_compressed_image(3, frame, jpeg))


@pytest.mark.parametrize("step", [0, 1, 400, 123_456])
def test_the_step_of_a_sequence_is_that_of_its_first_element(step):
    transform = Transform("map", "base", (1.0, 2.0, 3.0), quaternion_of_yaw(0.5))
    assert step_of_cdr(topics.TF, to_tf(step, [transform, transform])) == step


def test_foreign_bytes_are_refused_by_the_topics_name(typestore):
    with pytest.raises(EpisodeError, match=topics.IMAGE.name):
        decode_cdr(typestore, topics.IMAGE, b"\x00\x01\x00\x00nonsense")
    with pytest.raises(EpisodeError, match="no stamp"):
        step_of_cdr(topics.IMAGE, b"\x00\x01\x00\x00")
    with pytest.raises(EpisodeError, match="/tf: a message without frames"):
        step_of_message(topics.TF, make_message(topics.TF.type_name, transforms=[]))


def test_a_stamp_with_a_second_of_nanoseconds_is_no_stamp(typestore):
    for sec, nanosec, right in ((2, 0, True), (1, 10**9, False), (2, 1, False), (-1, 950_000_000, False)):
        clock = make_message(topics.CLOCK.type_name, clock=stamp(0))
        clock.clock.sec, clock.clock.nanosec = sec, nanosec
        cdr = encode_cdr(typestore, topics.CLOCK, clock)
        if right:
            assert step_of_cdr(topics.CLOCK, cdr) == step_of_message(topics.CLOCK, clock) == 40
        else:
            with pytest.raises(EpisodeError, match="/clock: the stamp"):
                step_of_cdr(topics.CLOCK, cdr)
            if sec >= 0:
                with pytest.raises(EpisodeError, match=r"/clock: .*stamp"):
                    step_of_message(topics.CLOCK, clock)


STEP = 27
FRAME = "somewhere"


def ones(dtypes):
    return {name: np.ones(1, dtype) for name, dtype in dtypes.items()}


TRUTH = GroundTruth(step=STEP, carrier_id=9, frame_id=FRAME, **ones(GROUND_TRUTH_DTYPES))
PICTURE = CameraTruth(step=STEP, **ones(CAMERA_TRUTH_DTYPES))
STATES = ActorStates(step=STEP, **ones(ACTOR_STATE_DTYPES))
ACTOR = ActorDescription(1, "v1", ActorClass.SEDAN, 4.6, 1.8, 1.4, (51, 102, 204), is_emv=True)


def read(topic, cdr):
    return decode_cdr(messages.typestore(), topic, cdr)


MESSAGES = {
    "picture": measurements.to_image(STEP, FRAME, np.zeros((2, 2), np.uint8)),
    "compressed picture": measurements.to_compressed_image(STEP, FRAME, b"jpeg"),
    "camera": measurements.to_camera_info(STEP, FRAME, CameraIntrinsics(8, 6, 3.0, 3.0, 4.0, 3.0)),
    "fix": measurements.to_nav_sat_fix(GnssFix(STEP, FRAME, 49.0, 8.0, 1.0, np.ones(3))),
    "labels of a picture": to_camera_truth(PICTURE, FRAME),
    "boxes in a picture": to_image_boxes(PICTURE, FRAME),
    "box": read(topics.BOXES, to_boxes(boxes_of(TRUTH, FRAME))).detections[0],
    "box in a picture": to_image_boxes(PICTURE, FRAME).detections[0],
}


def time_of(message):
    stamp = message.header.stamp if hasattr(message, "header") else message.stamp
    return int(stamp.sec), int(stamp.nanosec)


@pytest.mark.parametrize("name", list(MESSAGES))
def test_a_message_has_the_time_of_its_step_and_the_frame(name):
    assert (time_of(MESSAGES[name]), MESSAGES[name].header.frame_id) == ((1, 350_000_000), FRAME)


def test_markers_have_the_time_of_their_step():
    markers = read(topics.MARKERS, to_markers(STEP, vehicle_markers(replace(STATES, step=STEP), {1: ACTOR}))).markers
    drawn = [marker for marker in markers if marker.action == 0]
    assert drawn
    assert {time_of(marker) for marker in drawn} == {(1, 350_000_000)}
