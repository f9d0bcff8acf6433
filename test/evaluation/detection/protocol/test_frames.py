"""Frames of several episodes in one row, and velocities of labels as the devkit computes them."""

from dataclasses import replace

import numpy as np
import pytest
from detection_boxes import truth_boxes
from evaluation.made_frames import PICTURED, STEPS, made_frames

from siren_ros.evaluation.detection.protocol.boxes import ATTRIBUTES, attributes_of
from siren_ros.evaluation.detection.protocol.frames import frames_of, in_range, velocities_of_annotations


def _velocities(steps: list[int], x_m: list[float], actors: list[int] | None = None) -> list[float]:
    centre = np.stack((np.array(x_m), np.zeros(len(x_m)), np.zeros(len(x_m))), axis=-1)
    ids = np.array(actors or [1] * len(steps), dtype=np.uint32)
    return velocities_of_annotations(np.array(steps, dtype=np.intp), ids, centre)[:, 0].tolist()


def test_the_way_between_the_neighbours_half_a_second_away() -> None:
    assert _velocities([0, 10, 20], [0.0, 1.0, 4.0]) == pytest.approx([2.0, 4.0, 6.0])
    assert _velocities([0, 2, 10, 12], [0.0, 0.0, 1.0, 3.0]) == pytest.approx([2.0, 6.0, 2.0, 6.0])


def test_gaps_of_more_than_the_devkits_limit_have_no_velocity() -> None:
    found = _velocities([0, 40, 60, 120], [0.0, 2.0, 4.0, 6.0])
    assert np.isnan(found[0])
    assert found[1:3] == pytest.approx([4.0 / 3.0, np.nan], nan_ok=True)
    assert np.isnan(found[3])


def test_vehicles_are_kept_apart() -> None:
    assert _velocities([0, 0, 10, 10], [0.0, 5.0, 1.0, 7.0], [1, 2, 1, 2]) == pytest.approx([2.0, 4.0, 2.0, 4.0])
    assert np.isnan(_velocities([0, 10], [0.0, 1.0], [1, 2])).all()


def test_attributes_follow_from_speeds() -> None:
    codes = attributes_of(np.array([[0.0, 0.2], [0.3, 0.1], [np.nan, 0.0]]))
    assert [ATTRIBUTES[code] for code in codes.tolist()] == ["vehicle.stopped", "vehicle.moving", ""]


def test_velocities_have_both_axes_whatever_the_height() -> None:
    centre = np.array([[0.0, 0.0, 9.0], [1.5, -2.0, 0.0], [4.0, -3.0, -9.0]])
    found = velocities_of_annotations(np.array([0, 10, 20]), np.full(3, 7, dtype=np.uint32), centre)
    assert found == pytest.approx(np.array([[3.0, -4.0], [4.0, -3.0], [5.0, -2.0]]))


@pytest.mark.parametrize(("steps", "known"), [((0, 30), True), ((0, 40), False), ((0, 30, 60), True)])
def test_one_and_a_half_seconds_to_each_side_are_the_limit(steps: tuple[int, ...], *, known: bool) -> None:
    found = _velocities(list(steps), [0.1 * step for step in steps])
    assert np.isfinite(found).all() == known
    if known:
        assert found == pytest.approx([2.0] * len(steps))


def test_frames_of_two_episodes_are_one_row() -> None:
    """Four frames each, at steps 0, 2, 10 and 12."""
    first, second = made_frames().episodes
    labels = truth_boxes(np.array([0, 3]), np.zeros((2, 3)), np.zeros((2, 2)), np.zeros(2))
    frames = frames_of([replace(first, truth=labels), replace(second, truth=labels)])
    assert (len(frames), frames.first.tolist()) == (8, [0, 4, 8])
    assert frames.episode.tolist() == [0] * 4 + [1] * 4
    assert frames.step.tolist() == list(STEPS) * 2
    assert frames.keyframe.tolist() == [True, False, True, False] * 2
    assert frames.pictured.tolist() == list(PICTURED) * 2
    assert frames.truth.frame.tolist() == [0, 3, 4, 7]
    assert list(frames.by_token.values()) == [0, 2, 4, 6]
    assert frames.vehicle_m[5] == pytest.approx([105.0, 50.0])
    assert frames.map_from_lidar[5][:2, 3] == pytest.approx([105.0, 50.0])
    assert frames.global_from_map_m[[0, 7]].tolist() == [[1000.0, 2000.0], [2000.0, 4000.0]]
    assert frames.told(6) == "episode1 step 10"
    assert frames.scored.all()


@pytest.mark.parametrize("direction_rad", [0.0, 2.0, -1.3])
@pytest.mark.parametrize(("away_m", "inside"), [(49.9, True), (50.1, False)])
def test_the_range_is_a_circle_around_the_vehicle(direction_rad: float, away_m: float, *, inside: bool) -> None:
    frames = made_frames()
    x_m, y_m = frames.vehicle_m[6] + away_m * np.array([np.cos(direction_rad), np.sin(direction_rad)])
    assert in_range(frames, np.array([6]), np.array([[x_m, y_m, 30.0]])).tolist() == [inside]
