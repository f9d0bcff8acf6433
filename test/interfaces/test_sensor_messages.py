from typing import Any

import numpy as np

from siren_ros.interfaces.audio import from_audio, to_audio
from siren_ros.interfaces.image_boxes import from_camera_truth, to_camera_truth, to_image_boxes
from siren_ros.interfaces.messages import typestore
from siren_ros.interfaces.navigation import (
    ImuReading,
    SatelliteFix,
    from_imu,
    from_nav_sat_fix,
    to_imu,
    to_nav_sat_fix,
)
from siren_ros.world.actors import ActorClass
from siren_ros.world.carrier import CAMERA_TRUTH_DTYPES, CameraTruth

STORE = typestore()


def through_cdr(message: Any, type_name: str) -> Any:
    return STORE.deserialize_cdr(STORE.serialize_cdr(message, type_name), type_name)


def test_an_imu_reading_survives_and_says_that_it_has_no_orientation() -> None:
    reading = ImuReading(7, "imu", np.array([0.1, -0.2, 9.8]), np.array([0.0, 0.0, 0.3]), 4e-4, 1e-6)
    message = through_cdr(to_imu(reading), "sensor_msgs/msg/Imu")
    assert message.orientation_covariance[0] == -1.0
    turn = message.orientation
    assert (turn.x, turn.y, turn.z, turn.w) == (0.0, 0.0, 0.0, 1.0)
    back = from_imu(message)
    assert back.specific_force_mps2.tolist() == reading.specific_force_mps2.tolist()
    assert back.angular_rate_radps.tolist() == reading.angular_rate_radps.tolist()
    assert (back.step, back.frame_id) == (7, "imu")
    assert (back.force_variance, back.rate_variance) == (4e-4, 1e-6)


def test_a_fix_survives_with_its_covariance() -> None:
    fix = SatelliteFix(4, "gnss", 49.001, 8.4, 1.9, np.array([1.0, 2.0, 3.0]))
    message = through_cdr(to_nav_sat_fix(fix), "sensor_msgs/msg/NavSatFix")
    assert message.position_covariance.tolist() == [1.0, 0, 0, 0, 2.0, 0, 0, 0, 3.0]
    assert message.position_covariance_type == 2
    back = from_nav_sat_fix(message)
    assert (back.step, back.latitude_deg, back.longitude_deg, back.altitude_m) == (4, 49.001, 8.4, 1.9)
    assert back.variance_m2.tolist() == [1.0, 2.0, 3.0]


def test_sound_survives() -> None:
    samples = np.arange(-400, 400, dtype=np.int16)
    rate, back = from_audio(through_cdr(to_audio(3, "ear", 16_000, samples), "siren_msgs/msg/AudioChunk"))
    assert rate == 16_000
    assert back.tolist() == samples.tolist()


def labels() -> CameraTruth:
    values: dict[str, Any] = {name: np.array([1, 2], dtype) for name, dtype in CAMERA_TRUTH_DTYPES.items()}
    values |= {
        "actor_class": np.array([int(ActorClass.BUS), int(ActorClass.AMBULANCE)], np.uint8),
        "u_min_px": np.array([9.5, 0.0]),
        "u_max_px": np.array([29.5, 0.0]),
        "v_min_px": np.array([-0.5, 0.0]),
        "v_max_px": np.array([99.5, 0.0]),
        "visible_px": np.array([1500, 0], np.uint32),
        "visible_fraction": np.array([0.75, 0.0]),
    }
    return CameraTruth(step=12, **values)


def test_labels_of_a_picture_survive() -> None:
    truth = labels()
    message = through_cdr(to_camera_truth(truth, "camera"), "siren_msgs/msg/CameraTruth")
    back = from_camera_truth(message)
    assert back.step == 12
    for name in CAMERA_TRUTH_DTYPES:
        assert getattr(back, name).tolist() == getattr(truth, name).tolist()


def test_only_what_shows_becomes_a_detection() -> None:
    message = through_cdr(to_image_boxes(labels(), "camera"), "vision_msgs/msg/Detection2DArray")
    assert [detection.id for detection in message.detections] == ["1"]
    found = message.detections[0]
    assert (found.bbox.center.position.x, found.bbox.center.position.y) == (19.5, 49.5)
    assert (found.bbox.size_x, found.bbox.size_y) == (20.0, 100.0)
    assert found.results[0].hypothesis.class_id == "bus"
    assert found.results[0].hypothesis.score == 0.75
    nowhere = found.results[0].pose
    place, turn = nowhere.pose.position, nowhere.pose.orientation
    assert (place.x, place.y, place.z) == (0.0, 0.0, 0.0)
    assert (turn.x, turn.y, turn.z, turn.w) == (0.0, 0.0, 0.0, 1.0)
    assert not np.any(nowhere.covariance)
