"""What a bag holds as exporters see it: its sensors, how they stand, steps, what is asked of it, and its licence."""

import re
import tomllib
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from datasets.made_bag import (
    BUS,
    CAR,
    EMV,
    FRONT,
    FRONT_M,
    LIDAR_M,
    REAR,
    REAR_M,
    BagSpec,
    described,
    image_truth_of,
    jpeg_of,
    place_of,
    sweep_of,
    truth_of,
    write_made_bag,
    yaw_of,
)
from repository import REPOSITORY
from synthetic_episode import NET_XML

from siren_ros.base.numerics.units import step_of_time_ns
from siren_ros.data.episode_source import (
    LICENCE,
    LICENCE_URL,
    EpisodeSource,
    Need,
    check_needs,
    lidar_frames,
    lidar_of,
    open_source,
    recording_command,
)
from siren_ros.data.interfaces.topics import ACTORS, GROUND_TRUTH, MAP, TRAFFIC
from siren_ros.data.recording.bag_reader import open_bag
from siren_ros.data.recording.bag_writer import EpisodeBagWriter
from siren_ros.errors import BagError
from siren_ros.simulation.scenario.episode import EpisodeEnd


@pytest.fixture(scope="module")
def source(made_bags: list[Path]) -> Iterator[EpisodeSource]:
    with open_source(made_bags[0]) as opened:
        yield opened


@pytest.fixture(scope="module")
def bare(made_drive: Path) -> Iterator[EpisodeSource]:
    with open_source(made_drive) as opened:
        yield opened


def test_who_it_is_and_how_it_ended(source, tmp_path, typestore):
    assert (source.description.template, source.description.seed, source.description.emv_ids) == ("S2", 0, (EMV,))
    assert (source.outcome.end.value, source.outcome.steps) == ("complete", 42)
    assert source.net_xml == NET_XML
    assert [edge.edge_id for edge in source.network.edges] == ["east", "west"]
    with open_source(write_made_bag(tmp_path / "cut", typestore, BagSpec(steps=14, cut_off=True))) as cut:
        assert cut.outcome is None


def test_an_end_of_more_steps_than_the_bag_holds_is_a_failure(tmp_path, typestore):
    whole = write_made_bag(tmp_path / "whole", typestore, BagSpec(steps=14))
    with open_bag(whole) as opened:
        writer = EpisodeBagWriter(tmp_path / "short", typestore, opened.latched)
        for message in opened.messages():
            if message.topic != ACTORS.name or step_of_time_ns(message.time_ns) < 5:
                writer.write(message.topic, message.type_name, message.cdr, message.time_ns)
    with open_source(writer.finish().path) as source:
        ended = (source.outcome.end, source.outcome.reason)
    assert ended == (EpisodeEnd.FAILED, "the bag holds 5 of the 14 steps that were closed")


def test_sensors_stand_where_the_tree_puts_them(source):
    lidar = source.lidar
    assert (lidar.name, lidar.topic) == ("lidar", "/emv/lidar/points")
    assert lidar.base_from_sensor @ [0.0, 0.0, 0.0, 1.0] == pytest.approx([*LIDAR_M, 1.0])
    front, rear = source.cameras
    assert [front.name, rear.name] == [FRONT, REAR]
    assert source.front_camera is front
    assert (front.topic, front.truth_topic) == (f"/emv/{FRONT}/image_raw/compressed", f"/emv/{FRONT}/ground_truth")
    assert (front.model.width, front.model.height, front.model.focal_x_px) == (64, 48, 32.0)
    for camera, place, ahead in ((front, FRONT_M, 1.0), (rear, REAR_M, -1.0)):
        seen = camera.base_from_sensor @ [0.0, 0.0, 3.0, 1.0]
        assert seen == pytest.approx([place[0] + 3.0 * ahead, place[1], place[2], 1.0]), "3 m along the optical axis"
    # A point 10 m ahead of the LiDAR: 1 m nearer to the camera, which is half a metre below it.
    assert front.from_lidar(lidar) @ [10.0, 2.0, 0.0, 1.0] == pytest.approx([-2.0, -0.5, 9.0, 1.0])
    assert source.station is None


def test_without_sensors_there_are_none(bare):
    assert (bare.lidar, bare.cameras, bare.front_camera, bare.station) == (None, (), None, None)
    assert [bare.has(topic) for topic in (ACTORS, MAP, GROUND_TRUTH)] == [True, True, False]
    with pytest.raises(BagError, match="with a LiDAR"):
        lidar_of(bare)


def test_a_camera_without_labels_has_no_topic_for_them(tmp_path, typestore):
    with open_source(write_made_bag(tmp_path / "bag", typestore, BagSpec(steps=14, image_labels=False))) as unlabelled:
        assert [camera.truth_topic for camera in unlabelled.cameras] == ["", ""]
        assert all(not frame.image_truths for frame in lidar_frames(unlabelled, cameras=unlabelled.cameras))


def test_messages_come_step_by_step(source):
    """States at every step, labels at every second one from 4 on."""
    steps = list(source.messages_by_step({ACTORS.name, GROUND_TRUTH.name}))
    assert [step for step, _ in steps] == list(range(42))
    for step, held in steps:
        labelled = step >= 4 and step % 2 == 0
        assert set(held) == ({ACTORS.name, GROUND_TRUTH.name} if labelled else {ACTORS.name})
        assert {message.time_ns for message in held.values()} == {50_000_000 * step}
    assert list(source.messages_by_step({"/nothing"})) == []
    assert [step for step, _ in source.messages_by_step({TRAFFIC.name})] == list(range(42))


def test_a_frame_has_sweep_labels_pictures_and_pose_of_its_step(source):
    frames = list(lidar_frames(source, cameras=source.cameras, pose=True))
    assert [frame.step for frame in frames] == list(range(4, 42, 2))
    for frame in frames[::6]:
        step = frame.step
        assert frame.points["x"].tolist() == sweep_of(step)["x"].tolist()
        assert frame.truth.x_m.tolist() == truth_of(step).x_m.tolist()
        assert frame.jpegs == {FRONT: jpeg_of(step, FRONT), REAR: jpeg_of(step, REAR)}
        seen = {name: labels.actor_id.tolist() for name, labels in frame.image_truths.items()}
        assert seen == {FRONT: [CAR], REAR: [BUS]}
        assert frame.image_truths[REAR].visible_fraction == image_truth_of(step, REAR).visible_fraction
        assert frame.map_from_base[:3, 3] == pytest.approx(place_of(step))
        ahead = frame.map_from_base @ [1.0, 0.0, 0.0, 0.0]
        assert ahead == pytest.approx([np.cos(yaw_of(step)), np.sin(yaw_of(step)), 0.0, 0.0])
    plain = next(lidar_frames(source))
    assert (plain.jpegs, plain.image_truths, plain.map_from_base) == ({}, {}, None)


@pytest.mark.parametrize(
    ("needs", "what", "suite"),
    [
        ((Need.LIDAR,), "a LiDAR with its ground truth", "lidar"),
        ((Need.FRONT_CAMERA,), "a front camera", "front"),
        ((Need.FRONT_CAMERA, Need.LIDAR), "a front camera and a LiDAR with its ground truth", "front"),
        ((Need.LIDAR, Need.CAMERA, Need.MAP), "a LiDAR with its ground truth and a camera", "full"),
    ],
)
def test_what_is_missing_is_told_with_the_smallest_suite_that_has_it(source, bare, needs, what, suite):
    with pytest.raises(BagError) as ended:
        check_needs(bare, "nuscenes", needs)
    assert f"an episode with {what}, for nuscenes; `" in str(ended.value)
    assert f" -p sensors:={suite}" in str(ended.value)
    check_needs(source, "all", tuple(Need))
    check_needs(bare, "tracks", (Need.TRACKS, Need.MAP, Need.EMV))


def test_a_recording_is_told_with_its_map_unless_it_is_the_default():
    description = replace(described(BagSpec(seed=7)).description, map_name="town", duration_s=12.5)
    command = recording_command(description, "full")
    assert command == (
        "ros2 run siren_ros cosim --ros-args -p template:=S2 -p level:=L2 -p seed:=7 -p duration_s:=12.5 "
        "-p preset:=paper -p sensors:=full"
    )
    assert recording_command(replace(description, map_name="other"), "full") == f"{command} -p map:=other"
    from_file = replace(description, parameters={"map": "/maps/my town.xodr"})
    assert recording_command(from_file, "full") == f"{command} -p map:='/maps/my town.xodr'"
    asked = {"site": "north", "values": "emv.speed_mps=12.5", "look": "clear", "av": "", "seed": 9}
    drawn = replace(description, parameters={"request": asked})
    assert recording_command(drawn, "full") == f"{command} -p site:=north -p values:=emv.speed_mps=12.5"


def test_one_licence_is_stated_everywhere():
    project = tomllib.loads((REPOSITORY / "pyproject.toml").read_text())["project"]
    packages = [REPOSITORY / "package.xml", REPOSITORY / "msg_defs" / "package.xml"]
    stated = [
        project["license"]["text"],
        *(re.search("<license>(.*)</license>", path.read_text())[1] for path in packages),
        re.search("^license: (.*)$", (REPOSITORY / "CITATION.cff").read_text(), re.MULTILINE)[1],
    ]
    assert stated == [LICENCE] * 4
    text = (REPOSITORY / "LICENSE").read_text()
    assert "Apache License" in text
    assert LICENCE_URL.rsplit("/", 1)[0].removeprefix("https://www.") in text
