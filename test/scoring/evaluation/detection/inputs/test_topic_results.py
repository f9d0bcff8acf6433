"""Detections recorded on a topic, in each of the frames that they may stand in."""

from pathlib import Path

import numpy as np
import pytest
from datasets.made_bag import LIDAR_M, BagSpec, place_of, truth_of, write_made_bag, yaw_of
from rosbags.typesys.store import Typestore

from siren_ros.data.interfaces.topics import BOXES, GROUND_TRUTH
from siren_ros.data.record.bag_survey import Need, in_dataset_order, survey_bag
from siren_ros.errors import InputError
from siren_ros.scoring.evaluation.detection.frames import Frames, frames_of, read_frames
from siren_ros.scoring.evaluation.detection.inputs.formats import read_detections
from siren_ros.scoring.evaluation.detection.inputs.topic_results import read_topic

SWEEPS = (8, 4)
"""Of two episodes: at every second step from 4 on."""


def frames_with(folder: Path, store: Typestore, boxes_frame: str) -> Frames:
    made = [BagSpec(steps=4 + 2 * count, seed=seed, boxes_frame=boxes_frame) for seed, count in enumerate(SWEEPS)]
    bags = [write_made_bag(folder / f"seed{episode.seed}", store, episode) for episode in made]
    surveys = [survey_bag(bag, "detection", (Need.LIDAR,), folder) for bag in bags]
    return frames_of([read_frames(*one) for one in in_dataset_order(surveys)])


def placed(step: int, local_m: np.ndarray) -> np.ndarray:
    """A place of the vehicle's frame in the map's."""
    cos, sin = np.cos(yaw_of(step)), np.sin(yaw_of(step))
    turned = [local_m[0] * cos - local_m[1] * sin, local_m[0] * sin + local_m[1] * cos, local_m[2]]
    return np.array(turned) + place_of(step)


@pytest.mark.parametrize("frame_id", ["lidar", "base_link", "map"])
def test_boxes_are_moved_into_the_map(tmp_path: Path, typestore: Typestore, frame_id: str) -> None:
    frames = frames_with(tmp_path, typestore, frame_id)
    found = read_topic("mine", BOXES.name, frames)
    assert (found.name, found.has_velocity, len(frames)) == ("mine", False, sum(SWEEPS))
    boxes = found.boxes
    assert boxes.frame.tolist() == np.repeat(np.arange(sum(SWEEPS)), 2).tolist()
    assert boxes.score.tolist() == [1.0] * 2 * sum(SWEEPS)
    steps = [4 + 2 * number for count in SWEEPS for number in range(count)]
    for row in range(len(boxes)):
        step = steps[int(boxes.frame[row])]
        truth, which = truth_of(step), row % 2
        numbers = np.array([truth.x_m[which], truth.y_m[which], truth.z_m[which]])
        local = numbers + LIDAR_M if frame_id == "lidar" else numbers
        expected = numbers if frame_id == "map" else placed(step, local)
        assert boxes.centre_m[row] == pytest.approx(expected)
        assert boxes.size_m[row] == pytest.approx([truth.length_m[which], truth.width_m[which], truth.height_m[which]])
        turned = truth.yaw_rad[which] + (0.0 if frame_id == "map" else yaw_of(step))
        assert np.exp(1j * boxes.yaw_rad[row]) == pytest.approx(np.exp(1j * turned))


def test_another_frame_or_topic_is_refused(tmp_path: Path, typestore: Typestore) -> None:
    frames = frames_with(tmp_path, typestore, "odom")
    with pytest.raises(InputError, match=r"'odom'.*lidar, base_link or map"):
        read_topic("mine", BOXES.name, frames)
    for topic in ("/nothing", GROUND_TRUTH.name):
        with pytest.raises(InputError, match=f"{topic} in .*{BOXES.name}"):
            read_topic("mine", topic, frames)
    with pytest.raises(InputError, match=f"/nothing in .*{BOXES.name}"):
        read_detections("mine", "topic:/nothing", frames)
