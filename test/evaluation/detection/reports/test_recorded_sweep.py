"""What the pictures show of a recorded sweep: returns where the labelled vehicles stand, none from the ground."""

from dataclasses import replace

import numpy as np

from siren_ros.evaluation.detection.protocol.frames import Frames
from siren_ros.evaluation.detection.reports.camera_view import front_picture
from siren_ros.evaluation.detection.reports.recorded_sweep import returns_from_above


def test_vehicles_with_many_points_have_returns_within_their_boxes(frames: Frames) -> None:
    (episode,) = frames.episodes
    row = 6
    returns = returns_from_above(episode, row)
    truth = episode.truth.at((episode.truth.frame == row) & (episode.truth.lidar_points >= 30))
    assert len(truth) > 2
    for centre, size, yaw in zip(truth.centre_m, truth.size_m, truth.yaw_rad, strict=True):
        away = returns - centre[:2]
        along = away @ np.array([np.cos(yaw), np.sin(yaw)])
        across = away @ np.array([-np.sin(yaw), np.cos(yaw)])
        inside = (abs(along) < size[0] / 2.0 + 0.1) & (abs(across) < size[1] / 2.0 + 0.1)
        assert inside.sum() > 10
    # The ground around the sensor has the densest rings of all, and is left out.
    near = np.hypot(*(returns - episode.vehicle_m[row]).T)
    assert (near < 6.0).mean() < 0.2


def test_a_step_without_a_sweep_has_no_returns(frames: Frames) -> None:
    (episode,) = frames.episodes
    changed = replace(episode, step=episode.step + 1_000_001)
    assert returns_from_above(changed, 0).shape == (0, 2)


def test_a_recorded_frame_has_its_picture(frames: Frames) -> None:
    (episode,) = frames.episodes
    picture = front_picture(episode, 4)
    assert picture is not None
    assert picture.rgb.shape == (picture.model.height, picture.model.width, 3)
    assert front_picture(replace(episode, pictured=np.zeros(len(episode), dtype=np.bool_)), 4) is None
