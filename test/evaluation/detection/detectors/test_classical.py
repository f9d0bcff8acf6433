"""Boxes around made returns, tracks of made vehicles, and a recorded episode."""

from dataclasses import replace

import numpy as np
import pytest

from siren_ros.evaluation.detection.detectors.box_fitting import fit_box
from siren_ros.evaluation.detection.detectors.classical import detect_classical
from siren_ros.evaluation.detection.detectors.tracker import Tracker, directed_yaw
from siren_ros.evaluation.detection.inputs.found_set import FoundSet
from siren_ros.evaluation.detection.metrics.devkit_score import devkit_score
from siren_ros.evaluation.detection.protocol.frames import Frames
from siren_ros.evaluation.detection.scoring import VEHICLE_NAMES, counted_boxes


def _two_sides(centre: tuple[float, float], length_m: float, width_m: float, yaw_rad: float) -> np.ndarray:
    """Returns from the two sides of a vehicle that face the origin."""
    along, across = np.linspace(-length_m / 2, length_m / 2, 60), np.linspace(-width_m / 2, width_m / 2, 30)
    turn = np.array([[np.cos(yaw_rad), -np.sin(yaw_rad)], [np.sin(yaw_rad), np.cos(yaw_rad)]])
    towards = -turn.T @ np.array(centre)
    sides = np.vstack(
        (
            np.column_stack((along, np.full(60, np.sign(towards[1]) * width_m / 2))),
            np.column_stack((np.full(30, np.sign(towards[0]) * length_m / 2), across)),
        )
    )
    flat = sides @ turn.T + centre
    return np.column_stack((flat, np.tile(np.linspace(-1.5, -0.2, 90), 1)))


@pytest.mark.parametrize("yaw_deg", [0.0, 20.0, -35.0, 80.0, -89.0])
@pytest.mark.parametrize("centre", [(12.0, 5.0), (-8.0, 14.0), (-15.0, -6.0)])
def test_two_sides_give_the_whole_box(yaw_deg: float, centre: tuple[float, float]) -> None:
    box = fit_box(_two_sides(centre, 5.2, 2.1, np.radians(yaw_deg)), ground_m=-1.9)
    assert box.centre_m[:2] == pytest.approx(centre, abs=0.1)
    assert box.size_m == pytest.approx([5.2, 2.1, 1.7], abs=0.1)
    assert abs(np.sin(box.yaw_rad - np.radians(yaw_deg))) < 0.02


def test_what_is_hidden_lies_behind_what_was_seen() -> None:
    """Only the rear is seen, 10 m ahead: the box reaches away from the sensor."""
    rear = np.column_stack((np.full(40, 10.0), np.linspace(-0.9, 0.9, 40), np.linspace(-1.5, -0.3, 40)))
    box = fit_box(rear, ground_m=-1.9)
    assert box.centre_m == pytest.approx([10.0 + 4.5 / 2, 0.0, -1.9 + 1.6 / 2], abs=0.1)
    assert abs(np.sin(box.yaw_rad)) < 0.02


def test_tracks_find_the_velocity() -> None:
    tracker = Tracker()
    for step in range(0, 80, 2):
        places = np.array([[8.0 * step * 0.05, 0.0], [30.0, 10.0 - 3.0 * step * 0.05]])
        velocity, sweeps = tracker.follow(step, places[:: 1 if step % 4 else -1], 0.05)
    assert sweeps.tolist() == [40, 40]
    assert np.sort(velocity, axis=0) == pytest.approx(np.array([[0.0, -3.0], [8.0, 0.0]]), abs=0.1)


def test_vehicles_that_leave_are_forgotten() -> None:
    tracker = Tracker()
    tracker.follow(0, np.array([[0.0, 0.0]]), 0.05)
    _, sweeps = tracker.follow(40, np.array([[0.0, 0.0]]), 0.05)
    assert sweeps.tolist() == [1]
    velocity, sweeps = tracker.follow(42, np.zeros((0, 2)), 0.05)
    assert (velocity.shape, sweeps.shape) == ((0, 2), (0,))


def test_the_front_is_where_a_vehicle_moves() -> None:
    found = directed_yaw(np.array([0.1, 0.1, 0.1]), np.array([[5.0, 0.0], [-5.0, 0.0], [-0.5, 0.0]]))
    assert np.cos(found) == pytest.approx(np.cos([0.1, 0.1 + np.pi, 0.1]))


def test_it_finds_vehicles_of_a_recorded_episode(frames: Frames) -> None:
    boxes = detect_classical(frames.episodes[0])
    score = devkit_score(*counted_boxes(frames, FoundSet("c", "c", boxes, frames.scored, True), VEHICLE_NAMES))
    assert score.average_precision[2.0] > 0.1
    assert score.errors["ATE"] < 1.0
    # The same once more, of the first few sweeps.
    (episode,) = frames.episodes
    again = detect_classical(replace(episode, step=episode.step[:4]))
    assert np.array_equal(boxes.at(boxes.frame < 4).centre_m, again.centre_m)
