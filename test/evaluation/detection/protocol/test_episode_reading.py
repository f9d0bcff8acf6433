"""Frames and boxes out of a bag of formulas."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from datasets.made_bag import (
    BUS,
    CAR,
    LIDAR_M,
    Made,
    place_of,
    truth_of,
    write_made_bag,
    yaw_of,
)
from evaluation.made_records import moving, record_with
from rosbags.typesys.store import Typestore

from siren_ros.datasets.exporting.survey import survey_bag
from siren_ros.datasets.sources.needs import Need
from siren_ros.evaluation.detection.protocol import episode_reading
from siren_ros.evaluation.detection.protocol.boxes import ATTRIBUTES
from siren_ros.evaluation.detection.protocol.episode_reading import _modes, read_frames
from siren_ros.evaluation.detection.protocol.frames import EpisodeFrames
from siren_ros.roads.road_network import RoadNetwork
from siren_ros.world.actors import Mode

STEPS = list(range(4, 42, 2))


@pytest.fixture(scope="module")
def episode(tmp_path_factory: pytest.TempPathFactory, typestore: Typestore) -> EpisodeFrames:
    folder = tmp_path_factory.mktemp("bag")
    bag = write_made_bag(folder / "bag", typestore, Made(seed=3))
    return read_frames(survey_bag(bag, "detection", (Need.LIDAR,), folder), "mine")


def test_every_labelled_sweep_is_a_frame(episode: EpisodeFrames) -> None:
    assert episode.step.tolist() == STEPS
    assert np.flatnonzero(episode.keyframe).tolist() == [STEPS.index(step) for step in (10, 20, 30, 40)]
    assert episode.pictured.all()
    assert (episode.episode_id, episode.template, episode.seed, episode.suite) == ("mine", "S2", 3, "made")
    assert episode.lidar_frame == "lidar"


def test_poses_are_those_of_the_steps(episode: EpisodeFrames) -> None:
    for row, step in enumerate(STEPS):
        x_m, y_m, z_m = place_of(step)
        assert episode.vehicle_m[row] == pytest.approx([x_m, y_m])
        origin = episode.map_from_lidar[row] @ [0.0, 0.0, 0.0, 1.0]
        ahead = LIDAR_M[0] * np.array([np.cos(yaw_of(step)), np.sin(yaw_of(step))])
        assert origin == pytest.approx([x_m + ahead[0], y_m + ahead[1], z_m + LIDAR_M[2], 1.0])
    assert episode.global_from_map_m.tolist() == [60.0, 66.0]
    assert episode.camera_from_lidar is not None
    assert episode.camera_from_lidar @ [10.0, 2.0, 0.0, 1.0] == pytest.approx([-2.0, -0.5, 9.0, 1.0])


def test_boxes_are_the_labels_in_the_map(episode: EpisodeFrames) -> None:
    truth = episode.truth
    assert truth.frame.tolist() == np.repeat(np.arange(len(STEPS)), 2).tolist()
    assert truth.actor_id.tolist() == [CAR, BUS] * len(STEPS)
    for row in range(len(truth)):
        step, which = STEPS[int(truth.frame[row])], row % 2
        labels = truth_of(step)
        local = np.array([labels.x_m[which], labels.y_m[which], labels.z_m[which], 1.0])
        assert truth.centre_m[row] == pytest.approx((episode.map_from_lidar[int(truth.frame[row])] @ local)[:3])
        assert np.exp(1j * truth.yaw_rad[row]) == pytest.approx(np.exp(1j * (labels.yaw_rad[which] + yaw_of(step))))
        sizes = [labels.length_m[which], labels.width_m[which], labels.height_m[which]]
        assert truth.size_m[row].tolist() == sizes
        assert truth.lidar_points[row] == labels.lidar_points[which]
    moving, stopped = ATTRIBUTES.index("vehicle.moving"), ATTRIBUTES.index("vehicle.stopped")
    assert truth.attribute.tolist() == [moving, stopped] * len(STEPS)
    # Half of the car is beyond the edge of the front picture; the rear camera sees nine tenths of the bus.
    assert truth.visible == pytest.approx([0.45, 0.9] * len(STEPS))


def test_velocities_are_differences_of_the_boxes_places(episode: EpisodeFrames) -> None:
    """As nuScenes has them: between the keyframe before and the one after."""
    truth = episode.truth
    rows = {step: 2 * STEPS.index(step) for step in (10, 20, 30, 40)}
    for before, at, after in ((10, 20, 30), (20, 30, 40)):
        for which in (0, 1):
            moved = truth.centre_m[rows[after] + which] - truth.centre_m[rows[before] + which]
            assert truth.velocity_mps[rows[at] + which] == pytest.approx(moved[:2] / (0.05 * (after - before)))


def test_modes_are_those_of_each_actors_state(straight_road: RoadNetwork, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a label whose actor has no state nothing is known: before the first, between two, and behind the last."""
    (there,) = record_with({key: moving(0.0, 0.0, 5.0, steps=1) for key in (3, 5, 9)}, straight_road).states
    states = replace(there, mode=np.array([Mode.YIELD_HOLD, Mode.REJOIN, Mode.STOPPED], dtype=np.uint8))
    monkeypatch.setattr(episode_reading, "from_actor_states", lambda _: states)
    message: Any = SimpleNamespace(read=lambda: None)
    asked = np.array([9, 1, 5, 4, 12, 3], dtype=np.uint32)
    nothing = Mode.NOMINAL
    assert _modes(asked, message).tolist() == [Mode.STOPPED, nothing, Mode.REJOIN, nothing, nothing, Mode.YIELD_HOLD]
    assert _modes(asked, None).tolist() == [nothing] * 6


@pytest.fixture(scope="module")
def sparse(tmp_path_factory: pytest.TempPathFactory, typestore: Typestore) -> EpisodeFrames:
    """Without the front camera's picture at steps 8 and 12, without labels at step 6."""
    folder = tmp_path_factory.mktemp("sparse")
    lacking = {8: "camera_front/image", 12: "camera_front/image", 6: "ground_truth"}
    bag = write_made_bag(folder / "bag", typestore, Made(steps=16), lambda topic, step: lacking.get(step, "-") in topic)
    return read_frames(survey_bag(bag, "detection", (Need.LIDAR,), folder), "mine")


def test_sweeps_without_labels_are_no_frames_and_some_have_no_picture(sparse: EpisodeFrames) -> None:
    assert sparse.step.tolist() == [4, 8, 10, 12, 14]
    assert sparse.pictured.tolist() == [True, False, True, False, True]
    assert sparse.truth.frame.tolist() == np.repeat(np.arange(5), 2).tolist()
