"""Every stamp of every topic of an episode is the simulated time of the step that made the message."""

from typing import Any

import pytest
from live_episodes import SMALL_SUITE

from siren_ros.base.numerics.units import STEP_NS
from siren_ros.data.interfaces import topics
from siren_ros.data.interfaces.messages import time_ns_of
from siren_ros.data.interfaces.topics import Topic
from siren_ros.data.recording.bag_reader import open_bag
from siren_ros.data.sensor_messages.sensor_topics import recorded_topics
from siren_ros.running.generation.closed_loop import record_episode
from siren_ros.running.generation.episode_setup import set_up_episode
from siren_ros.running.seat.drivers.drivers import driver_of
from siren_ros.running.seat.seated import answers_of
from siren_ros.sensing.camera.renderer import DrawingContext, RendererUnavailableError
from siren_ros.sensing.suite import load_suite
from siren_ros.simulation.scenario.episode import EpisodeRequest

STEPS = 30
CAMERA = """
cameras:
  camera_front:
    {mount: {x_m: 2.5, y_m: 0.0, z_m: 1.0}, width: 64, height: 48, rate_hz: 5, depth: true, semantic: true}
"""
SLOW_LIDAR = SMALL_SUITE.replace("rate_hz: 20", "rate_hz: 10")
FRAMES = {
    "/tf": {("map", "odom"), ("odom", "base_link"), ("map", "av/odom"), ("av/odom", "av/base_link")},
    "/tf_static": {("base_link", "lidar"), ("av/base_link", "av/lidar")},
    "/emv/odom": {("odom", "base_link")},
    "/av/odom": {("av/odom", "av/base_link")},
    "/emv/ground_truth": {("lidar",)},
    "/av/ground_truth": {("av/lidar",)},
    "/emv/ground_truth/boxes": {("lidar",)},
    "/av/ground_truth/boxes": {("av/lidar",)},
    "/emv/lidar/points": {("lidar",)},
    "/av/lidar/points": {("av/lidar",)},
    "/siren/markers": {("map",)},
    "/av/route": {("map",)},
}
OPTICAL = {("camera_front_optical_frame",)}
CAMERA_FRAMES = {
    "/tf_static": FRAMES["/tf_static"] | {("base_link", "camera_front"), ("base_link", "camera_front_optical_frame")},
    **dict.fromkeys(
        (
            "/emv/camera_front/depth/image_raw",
            "/emv/camera_front/semantic/image_raw",
            "/emv/camera_front/image_raw/compressed",
            "/emv/camera_front/camera_info",
        ),
        OPTICAL,
    ),
}


def can_draw() -> bool:
    try:
        DrawingContext().gl.release()
    except RendererUnavailableError:
        return False
    return True


def stamps_of(message: Any) -> list[tuple[int, tuple[str, ...]]]:
    """Every stamp in a message with the frames that belong to it."""
    if hasattr(message, "clock"):
        return [(time_ns_of(message.clock), ())]
    if hasattr(message, "stamp"):
        return [(time_ns_of(message.stamp), ())]
    stamps = []
    if hasattr(message, "header"):
        child = (message.child_frame_id,) if hasattr(message, "child_frame_id") else ()
        stamps.append((time_ns_of(message.header.stamp), (message.header.frame_id, *child)))
    for part in ("transforms", "markers", "detections", "poses"):
        for item in getattr(message, part, ()):
            stamps += stamps_of(item)
    return stamps


@pytest.fixture(scope="module", name="log")
def _log(tmp_path_factory: pytest.TempPathFactory) -> tuple[dict[str, Topic], dict[str, list[Any]]]:
    """Every topic of an episode with an AV under test, and the step and the stamps of each of its messages."""
    folder = tmp_path_factory.mktemp("clocks")
    suite, av_suite = folder / "suite.yaml", folder / "av_suite.yaml"
    suite.write_text(SMALL_SUITE + (CAMERA if can_draw() else ""), encoding="utf-8")
    av_suite.write_text(SLOW_LIDAR, encoding="utf-8")
    request = EpisodeRequest(sensors=str(suite), av_sensors=str(av_suite), av="civilian", duration_s=STEPS / 20)
    setup = set_up_episode(request)
    record_episode(setup, folder / "bag", answers_of(setup, driver_of("idm")))
    expected = (*recorded_topics(load_suite(str(suite)), load_suite(str(av_suite))), topics.EPISODE_END)
    with open_bag(folder / "bag") as bag:
        log: dict[str, list[Any]] = {name: [] for name in bag.type_names}
        for message in bag.messages(bag.type_names):
            log[message.topic].append((message.time_ns // STEP_NS, stamps_of(message.read())))
    return {topic.name: topic for topic in expected}, log


def test_every_topic_has_exactly_the_messages_of_its_rate(log: Any) -> None:
    topics_by_name, messages = log
    assert messages.keys() == topics_by_name.keys()
    for name, topic in topics_by_name.items():
        steps = [step for step, _ in messages[name]]
        assert steps == (steps[:1] if topic.latched else list(range(0, STEPS, topic.period_steps))), name
    assert {topic.period_steps for topic in topics_by_name.values()} >= {0, 1, 2, 4}


def test_every_stamp_is_the_time_of_its_step(log: Any) -> None:
    topics_by_name, messages = log
    unstamped = {name for name in topics_by_name if not any(stamps for _, stamps in messages[name])}
    assert unstamped == {topics.MAP.name, topics.SENSING.name}
    for name, topic in topics_by_name.items():
        last = topic in (topics.OUTCOME, topics.EPISODE_END)
        for step, stamps in messages[name]:
            expected = STEPS - 1 if last else 0 if topic.latched else step
            assert {stamp for stamp, _ in stamps} <= {expected * STEP_NS}, (name, step)


def test_every_message_is_in_its_frame(log: Any) -> None:
    _, messages = log
    expected = FRAMES | CAMERA_FRAMES if "/emv/camera_front/camera_info" in messages else FRAMES
    frames_by_topic = {
        name: {frames for _, stamps in entries for _, frames in stamps if frames} for name, entries in messages.items()
    }
    assert {name: frames for name, frames in frames_by_topic.items() if frames} == expected
