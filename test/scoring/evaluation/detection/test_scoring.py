"""Boxes that count, parts of the labels and intervals over episodes, of random boxes and by hand."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from known_outputs import assert_known
from made_detections import STEPS, busy_episodes, columns_ahead, found_boxes, made_frames, random_boxes, truth_boxes

from siren_ros.base.tables import Interval, text_of
from siren_ros.scoring.evaluation.detection.boxes import ATTRIBUTES, FoundBoxes, FoundSet, TruthBoxes, joined
from siren_ros.scoring.evaluation.detection.frames import Frames, frames_of
from siren_ros.scoring.evaluation.detection.metrics import ERRORS, devkit_score, devkit_tracking
from siren_ros.scoring.evaluation.detection.scoring import (
    VEHICLE_NAMES,
    DetectorScores,
    counted_boxes,
    counted_people,
    mean_ap_of_episodes,
    score_detector,
)
from siren_ros.scoring.evaluation.detection.tables import scores_as_json, tables_of
from siren_ros.scoring.evaluation.detection.tracking import score_tracking
from siren_ros.scoring.evaluation.scores import Score
from siren_ros.simulation.dynamics.vehicle_model import load_vehicle_parameters
from siren_ros.simulation.scenario.episode import SeenEpisodes
from siren_ros.simulation.world.actors import FIRST_PARKED_ID, ActorClass, Mode

FRAMES = 10


def _episodes(templates: list[str]) -> tuple[Frames, FoundSet]:
    """Random labels and detections around the origin."""
    pose, episodes, boxes = np.tile(np.eye(4), (FRAMES, 1, 1)), [], []
    for number, template in enumerate(templates):
        truth, detected = random_boxes(np.random.default_rng(number), FRAMES)
        truth.mode[::3] = Mode.YIELD_HOLD
        truth.actor_class[::4] = ActorClass.POLICE
        truth.visible[::2] = 0.5
        steps, pictured = np.arange(FRAMES, dtype=np.intp) * 2, np.ones(FRAMES, dtype=np.bool_)
        episode = replace(made_frames(camera=False).episodes[0], template=template, episode_id=f"{template}_{number}")
        places = {"map_from_lidar": pose, "vehicle_m": np.zeros((FRAMES, 2)), "global_from_map_m": np.zeros(2)}
        episodes.append(replace(episode, seed=number, step=steps, pictured=pictured, truth=truth, **places))
        boxes.append(replace(detected, frame=detected.frame + number * FRAMES))
    frames = frames_of(episodes)
    return frames, found_set(joined(boxes), frames)


def found_set(boxes: FoundBoxes, frames: Frames) -> FoundSet:
    return FoundSet("made", "made", boxes, frames.scored, has_velocity=True)


def scored_set(frames: Frames, detected: FoundSet) -> DetectorScores:
    return score_detector(frames, detected, VEHICLE_NAMES, lambda tables: [devkit_score(*pair) for pair in tables])


def _scores(templates: list[str]) -> DetectorScores:
    return scored_set(*_episodes(templates))


def value_of(scores: DetectorScores, group: str, metric: str = "mAP") -> Interval:
    """The one row of a group by its name."""
    (row,) = (row for row in scores.rows if (row.group, row.metric) == (group, metric))
    return row.interval


def test_the_mean_counts_each_template_once_and_intervals_need_several_episodes_of_each() -> None:
    scores = _scores(["S1"] * 5 + ["S2"])
    assert list(scores.templates) == ["S1", "S2"]
    for error in ERRORS:
        of_templates = [score.errors[error] for score in scores.templates.values()]
        assert value_of(scores, "all", error).value == pytest.approx(np.mean(of_templates)), error
    one = value_of(scores, "S1")
    assert one.bounded
    assert one.high - one.low > 0.01
    assert not value_of(scores, "S2").bounded
    assert not value_of(scores, "all").bounded


def test_the_order_of_the_families_is_tested_where_all_are_there() -> None:
    every = [f"S{number}" for number in range(1, 8)]
    assert _scores(every).order == {}, "one episode of each cannot tell"
    order = _scores(every * 2).order
    assert list(order) == ["clearance < stop sign", "stop sign < shoulder", "shoulder < red light", "all"]
    assert 0.0 <= order["all"] <= min(order.values()) <= 1.0
    assert _scores(["S1", "S1"]).order == {}


Place = tuple[int, float]
"""Frame, and metres ahead of the LiDAR."""


def labels(*places: Place) -> TruthBoxes:
    """Labels with 50 returns each, which stand."""
    return truth_boxes(*columns_ahead(places))


def detections(*places: Place) -> FoundBoxes:
    """The first ones are the most confident."""
    return found_boxes(*columns_ahead(places), np.linspace(0.9, 0.1, len(places)))


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


def scored(frames: Frames, boxes: FoundBoxes) -> DetectorScores:
    return scored_set(frames, found_set(boxes, frames))


def part(scores: DetectorScores, name: str) -> Score:
    (found,) = (row for row in scores.rows if row.group == name)
    return found


def test_boxes_count_within_fifty_metres_labels_with_a_return_and_detections_with_a_vehicles_name() -> None:
    truth = labels((1, 49.9), (1, -50.1), (6, 10.0), (6, 20.0), (6, -49.9))
    truth.lidar_points[:] = (1, 50, 0, 3, 50)
    boxes = detections((1, 49.9), (1, 50.1), (6, 10.0), (6, 20.0), (6, 60.0))
    boxes = replace(boxes, label=np.array(["car", "car", "pedestrian", "fire_truck", "tree"]))
    frames = frames_with(truth)
    wanted, near = counted_boxes(frames, found_set(boxes, frames), VEHICLE_NAMES)
    assert wanted.frame.tolist() == [1, 6, 6]
    assert wanted.lidar_points.tolist() == [1, 3, 50]
    assert list(zip(near.frame.tolist(), near.label.tolist(), strict=True)) == [(1, "car"), (6, "fire_truck")]
    keyframes = replace(found_set(boxes, frames), scored=frames.keyframe)
    wanted, near = counted_boxes(frames, keyframes, VEHICLE_NAMES)
    assert (wanted.frame.tolist(), near.frame.tolist()) == ([6, 6], [6]), "frame 1 is none"


def with_people() -> tuple[Frames, FoundBoxes]:
    """A car, a walker at 39.9 m and one at 40.1 m, a cyclist; each is found by its name, the cyclist as a car, too."""
    truth = labels((0, 10.0), (0, 39.9), (0, 40.1), (1, 20.0))
    truth.actor_class[1:] = (ActorClass.PEDESTRIAN, ActorClass.PEDESTRIAN, ActorClass.BICYCLE)
    boxes = detections((0, 10.0), (0, 39.9), (0, 40.1), (1, 20.0), (1, 20.0))
    return frames_with(truth), replace(boxes, label=np.array(["car", "pedestrian", "person", "cyclist", "car"]))


def test_people_count_by_their_own_names_and_ranges() -> None:
    frames, boxes = with_people()
    wanted, near = counted_boxes(frames, found_set(boxes, frames), VEHICLE_NAMES)
    assert wanted.actor_class.tolist() == [ActorClass.HATCHBACK]
    assert near.frame.tolist() == [0, 1], "the cyclist is no car"
    walkers, found = counted_people(frames, found_set(boxes, frames), ActorClass.PEDESTRIAN)
    assert (len(walkers), found.label.tolist()) == (1, ["pedestrian"])
    assert {ATTRIBUTES[code] for code in (*walkers.attribute, *found.attribute)} == {"pedestrian.standing"}
    riders, found = counted_people(frames, found_set(boxes, frames), ActorClass.BICYCLE)
    assert (len(riders), found.label.tolist()) == (1, ["cyclist"])


@pytest.mark.parametrize("has_attributes", [True, False])
def test_attributes_of_labels_follow_from_their_speed_where_the_format_has_none(*, has_attributes: bool) -> None:
    truth = replace(labels((0, 10.0), (0, 20.0)), velocity_mps=np.array([[5.0, 0.0], [0.0, 0.0]]))
    truth.attribute[:] = 3
    frames = frames_with(truth)
    given = replace(found_set(detections(), frames), has_attributes=has_attributes)
    wanted, _ = counted_boxes(frames, given, VEHICLE_NAMES)
    assert wanted.attribute.tolist() == ([3, 3] if has_attributes else [1, 2])


def test_each_part_has_its_labels_and_the_share_of_them_that_is_found() -> None:
    """Labels 1 and 3 are missed. Precision is 1 up to the share that is found; recalls up to 0.1 do not count."""
    truth = labels((0, 5.0), (0, -14.9), (1, 20.0), (5, 28.0), (5, 40.0), (6, -45.0), (6, 15.1))
    truth.mode[:] = (
        Mode.NOMINAL, Mode.REJOIN, Mode.YIELD_HOLD, Mode.STOPPED, Mode.GAP_ESCAPE, Mode.YIELD_HOLD, Mode.REJOIN,
    )  # fmt: skip
    truth.actor_id[5] = FIRST_PARKED_ID
    truth.lidar_points[:] = (1, 4, 5, 19, 99, 100, 20)
    truth.visible[:] = (0.39, 0.4, 0.5, 0.6, 0.8, 1.0, 0.79)
    kinds = (ActorClass.SUV, ActorClass.FIRE_TRUCK, ActorClass.POLICE, ActorClass.POLICE, *[ActorClass.SUV] * 3)
    truth.actor_class[:] = kinds
    suv = load_vehicle_parameters()[ActorClass.SUV]
    truth.size_m[4] = suv.length_m, suv.width_m, suv.height_m
    truth.size_m[6] = suv.length_m, suv.width_m, suv.height_m + 0.03
    found = detections((0, 5.0), (1, 20.0), (5, 40.0), (6, -45.0), (6, 15.1))
    scores = scored(frames_with(truth), found)
    parts = {
        ("behaviour", "nominal"): {0, 4},
        ("behaviour", "yielding"): {1, 6},
        ("behaviour", "held"): {2, 3},
        ("behaviour", "parked"): {5},
        ("size", "of their class"): {4},
        ("size", "another one"): {0, 1, 2, 3, 5, 6},
        ("distance", "0-15 m"): {0, 1},
        ("distance", "15-30 m"): {2, 3, 6},
        ("distance", "30-50 m"): {4, 5},
        ("LiDAR points", "1 to 4"): {0, 1},
        ("LiDAR points", "5 to 19"): {2, 3},
        ("LiDAR points", "20 to 99"): {4, 6},
        ("LiDAR points", "100 and more"): {5},
        ("visible", "0-40 %"): {0},
        ("visible", "40-60 %"): {1, 2},
        ("visible", "60-80 %"): {3, 6},
        ("visible", "80-100 %"): {4, 5},
        ("emergency vehicles", "ambulance"): set(),
        ("emergency vehicles", "fire truck"): {1},
        ("emergency vehicles", "police"): {2, 3},
    }

    def row(kind: str, name: str, members: set[int]) -> tuple[str, str, str, str, float | None, int]:
        if not members:
            return "made", kind, name, "mAP", None, 0
        recall = int(100.0 * len(members - {1, 3}) / len(members) + 1e-9)
        return "made", kind, name, "mAP", pytest.approx(max(recall - 10, 0) / 90.0), len(members)

    got = [(one.model, one.kind, one.group, one.metric, one.value, one.samples) for one in scores.rows]
    both = {"S1": {0, 1, 2}, "S2": {3, 4, 5, 6}}
    templates = [row("template", name, members) for name, members in both.items()]
    mean = sum(max(int(100.0 * share + 1e-9) - 10, 0) / 90.0 for share in (2.0 / 3.0, 3.0 / 4.0)) / 2.0
    assert [one for one in got if one[1] in {"all", "template", "family"} and one[3] == "mAP"] == [
        ("made", "all", "all", "mAP", pytest.approx(mean), 7),
        *templates,
        ("made", "family", "clearance", "mAP", pytest.approx(mean), 7),
    ]
    assert [one for one in got if one[1] not in {"all", "template", "family"}] == [
        row(*part, members) for part, members in parts.items()
    ]


def test_a_family_has_a_row_where_all_of_its_templates_are_there() -> None:
    """S1 and S2 are one; S3 alone is not the other."""
    truth = labels((0, 10.0), (4, 10.0), (8, 10.0))
    boxes = detections((0, 10.0), (4, 30.0), (8, 10.0))
    both = scored(frames_with(truth, ("S1", "S2")), boxes.at(boxes.frame < 8))
    assert [row.group for row in both.rows if row.kind == "family"] == ["clearance"]
    scores = scored(frames_with(truth, ("S1", "S2", "S3")), boxes)
    assert value_of(scores, "clearance").value == pytest.approx(0.5)
    assert [row.group for row in scores.rows if row.kind == "family"] == ["clearance"]
    assert scores.order == {}


def test_an_interval_is_students_over_the_episodes() -> None:
    """Of six episodes every second one is found: AP is 40/90, 50/90 without a missed one and 30/90 without a found one.

    Precision is 1 up to the recall of 3/6, 3/5 or 2/5, which counts from 0.1 on.
    """
    places = [(4 * number, 10.0) for number in range(6)]
    scores = scored(frames_with(labels(*places), ["S1"] * 6), detections(*places[::2]))
    ap = value_of(scores, "S1")
    left_out = np.array([30 / 90, 50 / 90] * 3)
    half = 2.5706 * np.sqrt(5 / 6 * ((left_out - left_out.mean()) ** 2).sum())
    assert (ap.value, ap.low, ap.high) == pytest.approx((40 / 90, 40 / 90 - half, 40 / 90 + half), abs=1e-4)
    assert ap.blocks == 6
    assert value_of(scores, "all") == ap
    held = part(scores, "nominal").interval
    assert (held.low, held.high) == pytest.approx((ap.low, ap.high))


def test_the_map_of_each_episode_is_that_of_the_episode_alone() -> None:
    """Three episodes, one of them without a label that counts."""
    frames, detected = _episodes(["S1", "S1", "S2"])
    bare = replace(frames.episodes[2], truth=frames.episodes[2].truth.at(np.zeros(len(frames.episodes[2].truth), bool)))
    frames = frames_of([*frames.episodes[:2], bare])
    values = mean_ap_of_episodes(frames, detected, VEHICLE_NAMES)
    for number in (0, 1):
        own = detected.boxes.frame // FRAMES == number
        boxes = replace(detected.boxes.at(own), frame=detected.boxes.frame[own] - number * FRAMES)
        alone = frames_of([frames.episodes[number]])
        assert values[number] == pytest.approx(scored_set(alone, found_set(boxes, alone)).rows[0].value)
    assert np.isnan(values[2])


def test_every_score_and_every_table_of_two_detectors_in_busy_episodes() -> None:
    """The second detector states neither velocities nor kinds, and was trained on one of the maps."""
    frames, boxes = busy_episodes()
    unknown = replace(boxes, label=np.full(len(boxes), "car"), velocity_mps=np.full((len(boxes), 2), np.nan))
    plain = replace(unknown, attribute=np.zeros(len(boxes), dtype=np.uint8)).at(boxes.score > 0.3)
    seen = SeenEpisodes(frozenset({"map0 S1 0", "map1 S2 7"}))
    first = found_set(boxes, frames)
    sets = first, replace(first, name="plain", boxes=plain, has_velocity=False, seen=seen, scored=frames.keyframe)
    scores = [scored_set(frames, one) for one in sets]
    few, found_there = busy_episodes("S1 S2", 22)
    tracks = score_tracking(
        few, found_set(found_there, few), VEHICLE_NAMES, lambda tables: [devkit_tracking(*each) for each in tables]
    )
    rows = {}
    for row in (*scores[0].rows, *scores[1].rows, *tracks):
        bounds = (row.interval.json()[bound] for bound in ("low", "high"))
        rows[f"{row.model} | {row.kind} | {row.group} | {row.metric}"] = [row.value, *bounds, row.samples]
    content = scores_as_json([replace(scores[0], rows=(*scores[0].rows, *tracks)), scores[1]])
    found = {
        "rows": rows,
        "tables": text_of(tables_of(content, compare_paper=True)),
        "episodes": [mean_ap_of_episodes(frames, one, VEHICLE_NAMES) for one in sets],
        "made": _without_curves(content["models"]["made"]),
        "plain": {name: value for name, value in content["models"]["plain"].items() if name != "curves"},
    }
    assert_known(Path(__file__).parent / "known" / "detection.json", found, digits=5)


def _without_curves(value: Any) -> Any:
    """Every twentieth point of lists of a hundred."""
    if isinstance(value, dict):
        return {name: _without_curves(item) for name, item in value.items()}
    if isinstance(value, list):
        return [_without_curves(item) for item in (value[::20] if len(value) > 50 else value)]
    return value
