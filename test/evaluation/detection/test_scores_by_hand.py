"""What counts, and what parts and intervals say of a few boxes in frames whose LiDAR is turned."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from detection_boxes import found_boxes, truth_boxes
from evaluation.made_frames import STEPS, made_frames, to_map

from siren_ros.evaluation.detection.boxes import FoundBoxes, TruthBoxes
from siren_ros.evaluation.detection.devkit_score import DevkitScore, devkit_score
from siren_ros.evaluation.detection.frames import Frames, frames_of
from siren_ros.evaluation.detection.inputs.formats import labels_as_detections
from siren_ros.evaluation.detection.inputs.stated_boxes import FoundSet
from siren_ros.evaluation.detection.scoring import (
    VEHICLE_NAMES,
    DetectorScores,
    GroupScore,
    counted_boxes,
    score_detector,
)
from siren_ros.world.actors import Mode

Place = tuple[int, float]
"""Frame, and metres ahead of the LiDAR."""


def labels(*places: Place) -> TruthBoxes:
    """Labels with 50 returns each, which stand."""
    centre = np.array([to_map(frame, ahead, 0.0, -1.0) for frame, ahead in places]).reshape(-1, 3)
    frame = np.array([frame for frame, _ in places], dtype=np.intp)
    return truth_boxes(frame, centre, np.zeros((len(places), 2)), np.zeros(len(places)))


def detections(*places: Place) -> FoundBoxes:
    """The first ones are the most confident."""
    centre = np.array([to_map(frame, ahead, 0.0, -1.0) for frame, ahead in places]).reshape(-1, 3)
    frame = np.array([frame for frame, _ in places], dtype=np.intp)
    score = np.linspace(0.9, 0.1, len(places))
    return found_boxes(frame, centre, np.zeros((len(places), 2)), np.zeros(len(places)), score)


def frames_with(truth: TruthBoxes, templates: Sequence[str] = ("S1", "S2")) -> Frames:
    """Four frames for each template, with the labels by the number of their frame."""
    first, second = made_frames().episodes
    episodes = []
    for number, template in enumerate(templates):
        here = truth.at(truth.frame // len(STEPS) == number)
        own = replace(here, frame=here.frame - number * len(STEPS))
        one = replace((first, second)[number % 2], template=template, seed=number, episode_id=f"e{number}", truth=own)
        shift = np.eye(4)
        shift[0, 3] = len(STEPS) * (number - number % 2)
        moved = np.array([shift @ pose for pose in one.map_from_lidar])
        episodes.append(replace(one, map_from_lidar=moved, vehicle_m=moved[:, :2, 3]))
    return frames_of(episodes)


def found_set(boxes: FoundBoxes, frames: Frames) -> FoundSet:
    return FoundSet("made", "made", boxes, frames.scored, has_velocity=True)


def scored(frames: Frames, boxes: FoundBoxes) -> DetectorScores:
    def run(tables: Sequence[tuple[TruthBoxes, FoundBoxes]]) -> list[DevkitScore]:
        return [devkit_score(*one) for one in tables]

    return score_detector(frames, found_set(boxes, frames), VEHICLE_NAMES, run)


def part(scores: DetectorScores, name: str) -> GroupScore:
    (found,) = (one for one in scores.groups if one.name == name)
    return found


def test_labels_count_within_fifty_metres_and_with_a_return() -> None:
    truth = labels((1, 49.9), (1, -50.1), (6, 10.0), (6, 20.0), (6, -49.9))
    truth.lidar_points[:] = (1, 50, 0, 3, 50)
    frames = frames_with(truth)
    wanted, _ = counted_boxes(frames, found_set(detections(), frames), VEHICLE_NAMES)
    assert wanted.frame.tolist() == [1, 6, 6]
    assert wanted.lidar_points.tolist() == [1, 3, 50]


def test_detections_count_within_fifty_metres_and_with_a_vehicles_name() -> None:
    boxes = detections((1, 49.9), (1, 50.1), (6, 10.0), (6, 20.0), (6, 60.0))
    boxes = replace(boxes, label=np.array(["car", "car", "pedestrian", "fire_truck", "tree"]))
    frames = frames_with(labels())
    _, near = counted_boxes(frames, found_set(boxes, frames), VEHICLE_NAMES)
    assert list(zip(near.frame.tolist(), near.label.tolist(), strict=True)) == [(1, "car"), (6, "fire_truck")]


def test_frames_that_the_format_lacks_do_not_count() -> None:
    frames = frames_with(labels((0, 10.0), (1, 10.0), (2, 10.0)))
    boxes = found_set(detections((0, 10.0), (1, 10.0), (2, 10.0)), frames)
    wanted, near = counted_boxes(frames, replace(boxes, scored=frames.keyframe), VEHICLE_NAMES)
    assert wanted.frame.tolist() == near.frame.tolist() == [0, 2]


@pytest.mark.parametrize("has_attributes", [True, False])
def test_attributes_of_labels_follow_from_their_speed_where_the_format_has_none(*, has_attributes: bool) -> None:
    truth = replace(labels((0, 10.0), (0, 20.0)), velocity_mps=np.array([[5.0, 0.0], [0.0, 0.0]]))
    truth.attribute[:] = 3
    frames = frames_with(truth)
    given = replace(found_set(detections(), frames), has_attributes=has_attributes)
    wanted, _ = counted_boxes(frames, given, VEHICLE_NAMES)
    assert wanted.attribute.tolist() == ([3, 3] if has_attributes else [1, 2])


def test_a_part_counts_no_detection_of_other_labels() -> None:
    """Both are found; the first label, which the most confident detection has found, is not held."""
    truth = labels((0, 10.0), (0, 20.0))
    truth.mode[:] = (Mode.NOMINAL, Mode.YIELD_HOLD)
    scores = scored(frames_with(truth), detections((0, 10.0), (0, 20.0)))
    assert (part(scores, "held").labels, part(scores, "nominal").labels) == (1, 1)
    assert part(scores, "held").mean_ap.value == pytest.approx(1.0)
    assert part(scores, "nominal").mean_ap.value == pytest.approx(1.0)
    assert part(scores, "yielding") == GroupScore("behaviour", "yielding", 0, part(scores, "yielding").mean_ap)
    assert not part(scores, "yielding").mean_ap.valid


def test_a_part_counts_all_false_alarms_and_one_by_distance_its_own() -> None:
    """A false alarm 40 m away is the most confident: the precision rises with the recall to a half.

    Recalls up to 0.1 do not count, nor does precision below 0.1.
    """
    truth = labels((0, 10.0))
    scores = scored(frames_with(truth), detections((0, 40.0), (0, 10.0)))
    recall = np.arange(11, 101) / 100.0
    assert part(scores, "nominal").mean_ap.value == pytest.approx(np.maximum(0.5 * recall - 0.1, 0.0).mean() / 0.9)
    assert part(scores, "0-15 m").mean_ap.value == pytest.approx(1.0)


def test_frames_labels_and_detections_of_each_template() -> None:
    truth = labels((0, 10.0), (1, 10.0), (6, 10.0))
    scores = scored(frames_with(truth), detections((0, 10.0), (6, 12.5), (7, 10.0)))
    assert scores.frames == {"S1": 4, "S2": 4}
    found = {name: (one.labels, one.detections) for name, one in scores.templates.items()}
    assert found == {"S1": (2, 1), "S2": (1, 2)}
    assert (len(scores.truth), len(scores.found)) == (3, 3)
    # Half of the labels of S1 are found: precision 1 from recall 0.11 to 0.5.
    first, second = (scores.templates[name].mean_average_precision for name in ("S1", "S2"))
    assert first == pytest.approx(40 / 90)
    # Of S2 the one label, at 4 m alone; at recall 1 the false alarm has halved the precision.
    assert second == pytest.approx((89 + (0.5 - 0.1) / 0.9) / 90 / 4)
    assert scores.mean_ap.value == pytest.approx((first + second) / 2)
    assert scores.mean_nds == pytest.approx(np.mean([scores.templates[name].nds for name in ("S1", "S2")]))


def test_a_family_has_a_row_where_all_of_its_templates_are_there() -> None:
    """S1 and S2 are one; S3 alone is not the other."""
    truth = labels((0, 10.0), (4, 10.0), (8, 10.0))
    boxes = detections((0, 10.0), (4, 30.0), (8, 10.0))
    assert list(scored(frames_with(truth, ("S1", "S2")), boxes.at(boxes.frame < 8)).families) == ["clearance"]
    scores = scored(frames_with(truth, ("S1", "S2", "S3")), boxes)
    assert scores.families["clearance"].value == pytest.approx(0.5)
    assert list(scores.families) == ["clearance"]
    assert scores.order is None


def test_an_interval_is_students_over_the_episodes() -> None:
    """Of six episodes every second one is found: AP is 40/90, 50/90 without a missed one and 30/90 without a found one.

    Precision is 1 up to the recall of 3/6, 3/5 or 2/5, which counts from 0.1 on.
    """
    places = [(4 * number, 10.0) for number in range(6)]
    scores = scored(frames_with(labels(*places), ["S1"] * 6), detections(*places[::2]))
    ap = scores.template_ap["S1"]
    left_out = np.array([30 / 90, 50 / 90] * 3)
    half = 2.5706 * np.sqrt(5 / 6 * ((left_out - left_out.mean()) ** 2).sum())
    assert (ap.value, ap.low, ap.high) == pytest.approx((40 / 90, 40 / 90 - half, 40 / 90 + half), abs=1e-4)
    assert ap.blocks == 6
    assert scores.mean_ap == ap
    held = part(scores, "nominal").mean_ap
    assert (held.low, held.high) == pytest.approx((ap.low, ap.high))


def test_a_template_that_one_episode_holds_all_labels_of_has_no_interval() -> None:
    """Without it nothing is left to find."""
    frames = frames_with(labels((0, 10.0), (0, 20.0)), ["S1"] * 6)
    ap = scored(frames, detections((0, 10.0), (4, 30.0))).template_ap["S1"]
    assert (ap.blocks, ap.bounded) == (6, False)


def test_labels_as_detections_are_those_with_a_return_the_nearer_the_surer() -> None:
    truth = labels((0, 10.0), (0, 20.0), (6, -30.0))
    truth.lidar_points[:] = (1, 0, 7)
    found = labels_as_detections(frames_with(truth))
    assert found.frame.tolist() == [0, 6]
    # Of the LiDAR's place in the plane.
    assert found.score == pytest.approx([1.0 / 1.1, 1.0 / 1.3])
    assert found.label.tolist() == ["car", "car"]
    assert found.centre_m == pytest.approx(truth.centre_m[[0, 2]])
