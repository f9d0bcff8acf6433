"""Every message carries the simulated time of its step, in the frame that is asked for."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from synthetic_episode import Scene, SyntheticEpisode

from siren_ros.interfaces.audio import to_audio
from siren_ros.interfaces.boxes import boxes_of, to_boxes, to_ground_truth
from siren_ros.interfaces.image_boxes import to_camera_truth, to_image_boxes
from siren_ros.interfaces.images import CameraIntrinsics, to_camera_info, to_compressed_image, to_image
from siren_ros.interfaces.markers import to_markers, vehicle_markers
from siren_ros.interfaces.navigation import ImuReading, SatelliteFix, to_imu, to_nav_sat_fix
from siren_ros.interfaces.transforms import Transform, to_odometry, to_tf
from siren_ros.world.actors import ACTOR_STATE_DTYPES, ActorClass, ActorDescription, ActorStates
from siren_ros.world.carrier import CAMERA_TRUTH_DTYPES, GROUND_TRUTH_DTYPES, CameraTruth, GroundTruth, Odometry

STEP = 27
FRAME = "somewhere"
ONE = np.ones(1)
TRUTH = GroundTruth(
    step=STEP,
    carrier_id=9,
    frame_id=FRAME,
    **{name: np.ones(1, dtype) for name, dtype in GROUND_TRUTH_DTYPES.items()},  # type: ignore[arg-type] # by name
)
PICTURE = CameraTruth(
    step=STEP,
    **{name: np.ones(1, dtype) for name, dtype in CAMERA_TRUTH_DTYPES.items()},  # type: ignore[arg-type] # by name
)
STATES = ActorStates(
    step=STEP,
    **{name: np.ones(1, dtype) for name, dtype in ACTOR_STATE_DTYPES.items()},  # type: ignore[arg-type] # by name
)
ACTOR = ActorDescription(1, "v1", ActorClass.SEDAN, 4.6, 1.8, 1.4, (51, 102, 204), is_emv=True)
MESSAGES = {
    "audio": to_audio(STEP, FRAME, 16_000, np.zeros(4, np.int16)),
    "picture": to_image(STEP, FRAME, np.zeros((2, 2), np.uint8)),
    "compressed picture": to_compressed_image(STEP, FRAME, b"jpeg"),
    "camera": to_camera_info(STEP, FRAME, CameraIntrinsics(8, 6, 3.0, 3.0, 4.0, 3.0)),
    "imu": to_imu(ImuReading(STEP, FRAME, np.zeros(3), np.zeros(3), 0.0, 0.0)),
    "fix": to_nav_sat_fix(SatelliteFix(STEP, FRAME, 49.0, 8.0, 1.0, np.ones(3))),
    "odometry": to_odometry(STEP, Odometry(*[0.0] * 6, np.eye(3), np.eye(3)), FRAME, "base"),
    "labels in space": to_ground_truth(TRUTH),
    "boxes in space": to_boxes(boxes_of(TRUTH, FRAME)),
    "labels of a picture": to_camera_truth(PICTURE, FRAME),
    "boxes in a picture": to_image_boxes(PICTURE, FRAME),
    "transform": to_tf(STEP, (Transform(FRAME, "child", (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0)),)).transforms[0],
    "box": to_boxes(boxes_of(TRUTH, FRAME)).detections[0],
    "box in a picture": to_image_boxes(PICTURE, FRAME).detections[0],
}


def time_of(message: Any) -> tuple[int, int]:
    stamp = message.header.stamp if hasattr(message, "header") else message.stamp
    return int(stamp.sec), int(stamp.nanosec)


@pytest.mark.parametrize("name", list(MESSAGES))
def test_a_message_has_the_time_of_its_step_and_the_frame(name: str) -> None:
    assert time_of(MESSAGES[name]) == (1, 350_000_000)
    assert MESSAGES[name].header.frame_id == FRAME


def test_markers_have_the_time_of_their_step() -> None:
    markers = to_markers(STEP, vehicle_markers(replace(STATES, step=STEP), {1: ACTOR})).markers
    drawn = [marker for marker in markers if marker.action == 0]
    assert drawn
    assert {time_of(marker) for marker in drawn} == {(1, 350_000_000)}


def test_all_messages_of_an_episode_have_the_time_of_their_step() -> None:
    episode = SyntheticEpisode(Scene(duration_s=1.5, lidar=True))
    seen = set()
    for topic, step, message in episode.messages():
        if hasattr(message, "header") or hasattr(message, "stamp"):
            seen.add(topic.name)
            assert time_of(message) == divmod(step * 50_000_000, 1_000_000_000), (topic.name, step)
        if hasattr(message, "step") and not hasattr(message, "encoding"):
            assert message.step == step
    assert len(seen) >= 6
