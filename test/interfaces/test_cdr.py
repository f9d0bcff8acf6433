import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rosbags.typesys.store import Typestore

from siren_ros.errors import EpisodeError
from siren_ros.interfaces import topics
from siren_ros.interfaces.cdr import decode_cdr, encode_cdr, step_of_cdr
from siren_ros.interfaces.images import to_compressed_image, to_image
from siren_ros.interfaces.messages import make_message, stamp
from siren_ros.interfaces.point_cloud import to_point_cloud
from siren_ros.interfaces.transforms import Transform, quaternion_of_yaw, to_tf
from siren_ros.ros.transport.wire import step_of_message
from siren_ros.sensors.lidar.lidar_points import LIDAR_POINT_DTYPE

frames = st.text("abcé_/", max_size=9)
"""Names of every length shift what follows them against the alignment."""


def assert_plain(store: Typestore, topic: topics.Topic, message: object) -> None:
    """The bytes are the store's own, filled up to whole words, and say the same."""
    cdr = encode_cdr(store, topic, message)
    plain = bytes(store.serialize_cdr(message, topic.type_name))
    assert len(cdr) % 4 == 0
    assert cdr == plain + bytes(len(cdr) - len(plain))
    assert len(cdr) - len(plain) < 4
    decoded = decode_cdr(store, topic, cdr)
    assert bytes(decoded.data) == bytes(message.data)  # type: ignore[attr-defined] # of every type here


@given(frames, st.integers(0, 5), st.integers(0, 1000))
def test_points_are_encoded_as_the_store_would(typestore: Typestore, frame: str, points: int, step: int) -> None:
    cloud = np.frombuffer(bytes(range(24)) * points, LIDAR_POINT_DTYPE)
    message = to_point_cloud(step, frame, cloud)
    assert_plain(typestore, topics.LIDAR, message)
    assert step_of_cdr(topics.LIDAR, encode_cdr(typestore, topics.LIDAR, message)) == step


@given(frames, st.integers(1, 5), st.integers(1, 5))
def test_pictures_are_encoded_as_the_store_would(typestore: Typestore, frame: str, rows: int, columns: int) -> None:
    rgb = np.arange(rows * columns * 3, dtype=np.uint8).reshape(rows, columns, 3)
    assert_plain(typestore, topics.IMAGE, to_image(3, frame, rgb))
    assert_plain(typestore, topics.IMAGE, to_image(3, frame, rgb[..., 0].astype(np.float32)))


@given(frames, st.binary(max_size=9))
def test_jpegs_are_encoded_as_the_store_would(typestore: Typestore, frame: str, jpeg: bytes) -> None:
    message = to_compressed_image(3, frame, jpeg)
    assert_plain(typestore, topics.IMAGE_COMPRESSED, message)


@pytest.mark.parametrize("step", [0, 1, 400, 123_456])
def test_the_step_of_a_sequence_is_that_of_its_first_element(typestore: Typestore, step: int) -> None:
    transform = Transform("map", "base", (1.0, 2.0, 3.0), quaternion_of_yaw(0.5))
    message = to_tf(step, [transform, transform])
    assert step_of_cdr(topics.TF, bytes(typestore.serialize_cdr(message, topics.TF.type_name))) == step


def test_foreign_bytes_are_refused_by_the_topics_name(typestore: Typestore) -> None:
    with pytest.raises(EpisodeError, match=topics.IMAGE.name):
        decode_cdr(typestore, topics.IMAGE, b"\x00\x01\x00\x00nonsense")
    with pytest.raises(EpisodeError, match="no stamp"):
        step_of_cdr(topics.IMAGE, b"\x00\x01\x00\x00")


def test_a_stamp_with_a_second_of_nanoseconds_is_no_stamp(typestore: Typestore) -> None:
    for sec, nanosec, right in ((2, 0, True), (1, 10**9, False), (2, 1, False), (-1, 950_000_000, False)):
        clock = make_message(topics.CLOCK.type_name, clock=stamp(0))
        clock.clock.sec, clock.clock.nanosec = sec, nanosec
        cdr = encode_cdr(typestore, topics.CLOCK, clock)
        if right:
            assert step_of_cdr(topics.CLOCK, cdr) == 40
            assert step_of_message(topics.CLOCK, clock) == 40
        else:
            with pytest.raises(EpisodeError, match="/clock: the stamp"):
                step_of_cdr(topics.CLOCK, cdr)
            if sec >= 0:
                with pytest.raises(EpisodeError, match=r"/clock: .*stamp"):
                    step_of_message(topics.CLOCK, clock)


def test_frames_without_a_frame_have_no_step() -> None:
    with pytest.raises(EpisodeError, match="/tf: a message without frames"):
        step_of_message(topics.TF, make_message(topics.TF.type_name, transforms=[]))
