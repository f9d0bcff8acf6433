"""The detector that ships, on the recorded sweeps and while they were recorded."""

import numpy as np
import pytest

from siren_ros.data.interfaces.topics import DETECTIONS
from siren_ros.scoring.evaluation.detection.boxes import CLASS_NAMES, FoundBoxes
from siren_ros.scoring.evaluation.detection.detectors.pillar_detector import detector_file, load_detector
from siren_ros.scoring.evaluation.detection.detectors.table import run_detector
from siren_ros.scoring.evaluation.detection.devkit_score import devkit_score
from siren_ros.scoring.evaluation.detection.frames import Frames
from siren_ros.scoring.evaluation.detection.inputs.stated_boxes import FoundSet
from siren_ros.scoring.evaluation.detection.inputs.topic_results import read_topic
from siren_ros.scoring.evaluation.detection.scoring import VEHICLE_NAMES, counted_boxes
from siren_ros.simulation.scenario.episode import SHIPPED_DETECTOR


@pytest.fixture(scope="module", name="found")
def _found(frames: Frames) -> FoundBoxes:
    return run_detector(SHIPPED_DETECTOR, frames.episodes[0], None)[0]


def test_it_finds_vehicles_of_a_recorded_episode(frames: Frames, found: FoundBoxes) -> None:
    boxes = FoundSet("p", "p", found, frames.scored, has_velocity=True)
    score = devkit_score(*counted_boxes(frames, boxes, VEHICLE_NAMES))
    assert score.mean_average_precision > 0.7
    assert score.errors["ATE"] < 0.4
    assert score.errors["AOE"] < 0.4


def test_the_node_said_the_same_while_the_episode_ran(frames: Frames, found: FoundBoxes) -> None:
    live = read_topic("live", DETECTIONS.name, frames).boxes
    assert np.array_equal(live.frame, found.frame)
    assert live.label.tolist() == found.label.tolist()
    for name in ("centre_m", "size_m", "score"):
        assert getattr(live, name) == pytest.approx(getattr(found, name), abs=1e-6)
    assert np.cos(live.yaw_rad - found.yaw_rad) == pytest.approx(np.ones(len(found)), abs=1e-6)


def test_its_card_says_what_it_was_trained_and_judged_on() -> None:
    network = load_detector(detector_file(SHIPPED_DETECTOR))
    assert network.class_names == CLASS_NAMES
    trained, judged = network.card["training"]["seeds_by_map"], network.card["judged"]
    assert {"test_seeds", "test_maps"} <= set(judged)
    keys = network.card["data"]["train"]["keys"]
    assert len(keys) == network.card["training"]["episodes"]
    assert {
        name: sorted({int(key.split()[2]) for key in keys if key.split()[0] == name}) for name in trained
    } == trained
    assert not set(judged["test_maps"]["seeds_by_map"]) & set(trained)
    for split in judged.values():
        assert all(not set(seeds) & set(trained.get(name, ())) for name, seeds in split["seeds_by_map"].items())
