"""Every stamp of every topic of a live episode is the simulated time of the step that made the message."""

import json
import subprocess
from dataclasses import astuple
from pathlib import Path
from typing import Any

import pytest
from live_episodes import EXAMPLES, SMALL_SUITE, Domain, finish

from siren_ros.base.numerics.units import STEP_NS
from siren_ros.data.interfaces import topics
from siren_ros.data.interfaces.topics import Topic
from siren_ros.data.sensor_messages.sensor_topics import AV, recorded_topics, suite_topics
from siren_ros.sensing.camera.renderer import DrawingContext, RendererUnavailableError
from siren_ros.sensing.suite import load_suite

DOMAIN = Domain(subprocess.Popen)
STEPS = 30
CAMERA = """
cameras:
  camera_front: {mount: {x_m: 2.5, y_m: 0.0, z_m: 1.0}, width: 64, height: 48, rate_hz: 5}
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
CAMERA_FRAMES = {
    "/tf_static": FRAMES["/tf_static"] | {("base_link", "camera_front"), ("base_link", "camera_front_optical_frame")},
    "/emv/camera_front/image_raw": {("camera_front_optical_frame",)},
    "/emv/camera_front/depth/image_raw": {("camera_front_optical_frame",)},
    "/emv/camera_front/semantic/image_raw": {("camera_front_optical_frame",)},
    "/emv/camera_front/instance/image_raw": {("camera_front_optical_frame",)},
    "/emv/camera_front/image_raw/compressed": {("camera_front_optical_frame",)},
    "/emv/camera_front/camera_info": {("camera_front_optical_frame",)},
}


def can_draw() -> bool:
    try:
        DrawingContext().gl.release()
    except RendererUnavailableError:
        return False
    return True


@pytest.fixture(scope="module", name="heard")
def _heard(tmp_path_factory: pytest.TempPathFactory) -> tuple[dict[str, Topic], dict[str, list[Any]]]:
    """Every topic of an episode with an AV under test, and what a participant heard of each."""
    folder = tmp_path_factory.mktemp("clocks")
    suite, av_suite = folder / "suite.yaml", folder / "av_suite.yaml"
    suite.write_text(SMALL_SUITE + (CAMERA if can_draw() else ""), encoding="utf-8")
    av_suite.write_text(SLOW_LIDAR, encoding="utf-8")
    suites = load_suite(str(suite)), load_suite(str(av_suite))
    unrecorded = [topic for topic in (*suite_topics(suites[0]), *suite_topics(suites[1], AV)) if not topic.recorded]
    topics_by_name = {topic.name: topic for topic in (*recorded_topics(*suites), *unrecorded)}
    (folder / "wanted.json").write_text(
        json.dumps([astuple(topic) for topic in topics_by_name.values()]), encoding="utf-8"
    )
    parameters = (
        f"sensors:={suite}",
        f"av_sensors:={av_suite}",
        "av:=civilian",
        "kitti:=false",
        f"duration_s:={STEPS / 20}",
        "external:=[witness]",
        "bag:=bag",
    )
    witness = str(Path(__file__).with_name("witness.py"))
    with (
        DOMAIN.episode(*parameters, cwd=folder) as episode,
        DOMAIN.running(witness, "witness", "wanted.json", "heard.json", cwd=folder) as listener,
        DOMAIN.running(str(EXAMPLES / "av_policy.py"), cwd=folder) as driver,
    ):
        runs = [finish(process) for process in (episode, listener, driver)]
    assert [run.code for run in runs] == [0, 0, 0], [(run.out, run.err) for run in runs]
    return topics_by_name, json.loads((folder / "heard.json").read_text(encoding="utf-8"))


def test_every_topic_brings_exactly_the_messages_of_its_rate(heard: Any) -> None:
    topics_by_name, log = heard
    for name, topic in topics_by_name.items():
        ticks = [tick for tick, _ in log[name]]
        if topic.latched:
            assert len(ticks) == 1, name
        else:
            assert ticks == list(range(0, STEPS, topic.period_steps)), name
    assert {topic.period_steps for topic in topics_by_name.values()} >= {0, 1, 2, 4}


def test_every_stamp_is_the_time_of_its_step(heard: Any) -> None:
    topics_by_name, log = heard
    unstamped = {name for name in topics_by_name if not any(stamps for _, stamps in log[name])}
    assert unstamped == {topics.MAP.name, topics.SENSING.name}
    for name, topic in topics_by_name.items():
        if topic == topics.OUTCOME:
            assert [stamp for _, [(stamp, _)] in log[name]] == [(STEPS - 1) * STEP_NS]
            continue
        for tick, stamps in log[name]:
            assert {stamp for stamp, _ in stamps} <= {0 if topic.latched else tick * STEP_NS}, (name, tick)


def test_every_message_is_in_its_frame(heard: Any) -> None:
    _, log = heard
    camera = "/emv/camera_front/camera_info" in log
    expected = FRAMES | CAMERA_FRAMES if camera else FRAMES
    frames_by_topic = {
        name: {tuple(frames) for _, stamps in entries for _, frames in stamps if frames}
        for name, entries in log.items()
    }
    assert {name: frames for name, frames in frames_by_topic.items() if frames} == expected
