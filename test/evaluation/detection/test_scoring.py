"""Rows of parts of the labels, intervals over episodes, tables."""

from dataclasses import replace

import numpy as np
import pytest
from detection_boxes import random_boxes

from siren_ros.evaluation.detection.devkit_score import devkit_score
from siren_ros.evaluation.detection.frames import EpisodeFrames, Frames, frames_of
from siren_ros.evaluation.detection.inputs.stated_boxes import FoundSet
from siren_ros.evaluation.detection.scoring import VEHICLE_NAMES, DetectorScores, score_detector
from siren_ros.evaluation.detection.subsets import subsets_of_episodes
from siren_ros.evaluation.detection.tables import scores_as_json, tables_of
from siren_ros.world.actors import ActorClass, Mode

FRAMES = 10


def _episodes(templates: list[str]) -> tuple[Frames, FoundSet]:
    episodes, boxes = [], []
    for number, template in enumerate(templates):
        truth, found = random_boxes(np.random.default_rng(number), FRAMES)
        truth.mode[::3] = Mode.YIELD_HOLD
        truth.actor_class[::4] = ActorClass.POLICE
        truth.visible[::2] = 0.5
        episodes.append(
            EpisodeFrames(
                bag="bag",
                episode_id=f"{template}_{number}",
                template=template,
                seed=number,
                step=np.arange(FRAMES, dtype=np.intp) * 2,
                map_from_lidar=np.tile(np.eye(4), (FRAMES, 1, 1)),
                vehicle_m=np.zeros((FRAMES, 2)),
                pictured=np.ones(FRAMES, dtype=np.bool_),
                lidar_frame="lidar",
                base_from_lidar=np.eye(4),
                camera_from_lidar=None,
                global_from_map_m=np.zeros(2),
                truth=truth,
            )
        )
        boxes.append(replace(found, frame=found.frame + number * FRAMES))
    frames = frames_of(episodes)
    joined = {
        name: np.concatenate([getattr(one, name) for one in boxes]) for name in type(boxes[0]).__dataclass_fields__
    }
    return frames, FoundSet("made", "made", type(boxes[0])(**joined), frames.scored, has_velocity=True)


def _scores(templates: list[str]) -> DetectorScores:
    frames, found = _episodes(templates)
    return score_detector(frames, found, VEHICLE_NAMES, lambda tables: [devkit_score(*one) for one in tables])


def test_the_mean_counts_each_template_once() -> None:
    scores = _scores(["S1", "S1", "S2"])
    by_template = [score.mean_average_precision for score in scores.templates.values()]
    assert list(scores.templates) == ["S1", "S2"]
    assert scores.mean_ap.value == pytest.approx(np.mean(by_template))
    assert scores.mean_nds == pytest.approx(np.mean([score.nds for score in scores.templates.values()]))


def test_intervals_need_several_episodes_of_each_template() -> None:
    scores = _scores(["S1"] * 5 + ["S2"])
    one = scores.template_ap["S1"]
    assert one.bounded
    assert one.low <= one.value <= one.high
    assert one.high - one.low > 0.01
    assert not scores.template_ap["S2"].bounded
    assert not scores.mean_ap.bounded


def test_the_order_of_the_families_is_tested_where_all_are_there() -> None:
    every = [f"S{number}" for number in range(1, 8)]
    assert _scores(every).order is None, "one episode of each cannot tell"
    order = _scores(every * 2).order
    assert order is not None
    assert list(order.steps) == ["clearance < stop sign", "stop sign < shoulder", "shoulder < red light"]
    assert 0.0 <= order.whole <= min(order.steps.values()) <= 1.0
    assert _scores(["S1", "S1"]).order is None


def test_parts_hold_their_labels_and_the_whole_is_the_whole() -> None:
    frames, found = _episodes(["S1", "S2"])
    truth = frames.truth
    near = np.hypot(truth.centre_m[:, 0], truth.centre_m[:, 1])
    scores = _scores(["S1", "S2"])
    labels = {(one.group, one.name): one.labels for one in scores.groups}
    assert labels["behaviour", "held"] == (truth.mode == Mode.YIELD_HOLD).sum()
    assert labels["behaviour", "nominal"] == (truth.mode == Mode.NOMINAL).sum()
    assert labels["emergency vehicles", "police"] == (truth.actor_class == ActorClass.POLICE).sum()
    assert labels["emergency vehicles", "ambulance"] == 0
    assert labels["visible", "40-60 %"] == (truth.visible == 0.5).sum()
    assert labels["distance", "0-15 m"] == (near < 15.0).sum()
    assert labels["LiDAR points", "20 to 99"] == len(truth)
    # All labels have as many points: that part is the whole, with the devkit's score over both templates.
    whole = next(one for one in scores.groups if (one.group, one.name) == ("LiDAR points", "20 to 99"))
    assert whole.mean_ap.value == pytest.approx(devkit_score(truth, found.boxes).mean_average_precision, abs=1e-9)


def test_a_part_whose_labels_are_all_found_scores_fully_without_false_alarms() -> None:
    frames, found = _episodes(["S1", "S1"])
    truth = frames.truth.at(frames.truth.mode == Mode.YIELD_HOLD)
    exact = replace(
        found.boxes.at(np.zeros(len(truth), dtype=np.intp)),
        frame=truth.frame,
        centre_m=truth.centre_m,
        score=np.linspace(0.9, 0.5, len(truth)),
    )
    scores = score_detector(
        frames, replace(found, boxes=exact), VEHICLE_NAMES, lambda tables: [devkit_score(*one) for one in tables]
    )
    parts = {one.name: one.mean_ap.value for one in scores.groups if one.group == "behaviour" and one.labels}
    assert parts == {"nominal": 0.0, "held": pytest.approx(1.0)}


def test_kinds_have_rows_where_a_detector_names_them() -> None:
    frames, found = _episodes(["S1", "S1", "S2"])
    assert not [one for one in _scores(["S1", "S1", "S2"]).groups if one.group == "found by name"]
    truth = frames.truth
    police = truth.actor_class == ActorClass.POLICE
    named = np.where(police, "police", "car")
    exact = replace(
        found.boxes.at(np.zeros(len(truth), dtype=np.intp)),
        frame=truth.frame,
        centre_m=truth.centre_m,
        score=np.linspace(0.9, 0.5, len(truth)),
        label=named,
    )

    def rows(label: np.ndarray) -> dict[str, tuple[int, float]]:
        boxes = replace(found, boxes=replace(exact, label=label))
        scores = score_detector(frames, boxes, VEHICLE_NAMES, lambda tables: [devkit_score(*one) for one in tables])
        groups = [one for one in scores.groups if one.group == "found by name"]
        return {one.name: (one.labels, one.mean_ap.value) for one in groups}

    right = rows(named)
    assert list(right) == ["car", "ambulance", "fire_truck", "police"]
    assert right["police"] == (police.sum(), pytest.approx(1.0))
    assert right["car"] == ((~police).sum(), pytest.approx(1.0))
    assert right["ambulance"] == (0, 0.0)
    wrong = rows(np.where(police, "fire_truck", "car"))
    assert wrong["police"] == (police.sum(), 0.0)
    assert wrong["car"] == right["car"]


def test_tables_have_the_papers_rows_where_asked() -> None:
    scores = [_scores(["S1", "S3"])]
    content = scores_as_json(scores)
    tables = {table.key: table for table in tables_of(content, compare_paper=True)}
    rows = {row[0]: row for row in tables["by_template"].cells()}
    assert tables["by_template"].head == ("detector", "S1", "S3", "mean")
    assert rows["SECOND (paper)"] == ("SECOND (paper)", "0.420/0.420", "0.631/0.563", "0.521/0.510")
    assert [row[0] for row in tables["errors"].cells()][1:] == [
        f"{name} (paper)" for name in ("PointPillars", "SECOND", "VoxelNeXt", "TransFusion-L")
    ]
    named = tables_of(scores_as_json([replace(scores[0], name="transfusion_l")]), compare_paper=True)[1]
    assert [row[0] for row in named.cells()] == ["transfusion_l", "TransFusion-L (paper)"]
    plain = tables_of(content)
    assert not any("paper" in row[0] for table in plain for row in table.cells())
    for table in plain:
        assert len(table.text()) == len(table.rows) + 2
        assert table.csv().count("\n") == len(table.rows) + 1
        assert table.latex().count(r"\\") == len(table.rows) + 1
        assert "%" not in table.latex().replace(r"\%", "").splitlines()[-3]
    assert set(scores_as_json(scores)["made"]["templates"]) == {"S1", "S3"}


def test_weather_and_sensors_have_rows_where_there_are_several() -> None:
    frames, found = _episodes(["S1", "S1", "S2"])
    assert subsets_of_episodes(frames) == ()
    looks = [replace(one, look=look, suite="lidar") for one, look in zip(frames.episodes, "rrc", strict=True)]
    changed = frames_of(looks)
    rows = subsets_of_episodes(changed)
    assert [(row.group, row.name) for row in rows] == [("weather", "c"), ("weather", "r")]
    clear = rows[0].labels(changed, changed.truth)
    assert clear.tolist() == (changed.truth.frame >= 2 * FRAMES).tolist()
    alone = score_detector(
        frames_of(looks[2:]),
        _of_last_episode(found),
        VEHICLE_NAMES,
        lambda tables: [devkit_score(*one) for one in tables],
    )
    scores = score_detector(changed, found, VEHICLE_NAMES, lambda tables: [devkit_score(*one) for one in tables])
    (row,) = (group for group in scores.groups if group.name == "c")
    assert row.mean_ap.value == pytest.approx(alone.mean_ap.value, abs=1e-6)
    assert row.labels == len(alone.truth)


def _of_last_episode(found: FoundSet) -> FoundSet:
    boxes = found.boxes.at(found.boxes.frame >= 2 * FRAMES)
    return replace(found, boxes=replace(boxes, frame=boxes.frame - 2 * FRAMES), scored=found.scored[2 * FRAMES :])
