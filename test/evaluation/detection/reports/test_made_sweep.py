"""What the pictures show of a bag of formulas: returns at a vehicle's height, the front camera's picture."""

from dataclasses import replace

import numpy as np
import pytest
from datasets.made_bag import FRONT_M, LIDAR_M, Made, place_of, sweep_of, write_made_bag, yaw_of
from rosbags.typesys.store import Typestore

from siren_ros.datasets.exporting.survey import survey_bag
from siren_ros.datasets.sources.needs import Need
from siren_ros.evaluation.detection.protocol.episode_reading import read_frames
from siren_ros.evaluation.detection.protocol.frames import EpisodeFrames
from siren_ros.evaluation.detection.reports.camera_view import front_picture
from siren_ros.evaluation.detection.reports.recorded_sweep import returns_from_above


@pytest.fixture(scope="module")
def episode(tmp_path_factory: pytest.TempPathFactory, typestore: Typestore) -> EpisodeFrames:
    """Five sweeps, at steps 4 to 12; without the front camera's picture at step 8."""
    folder = tmp_path_factory.mktemp("bag")
    made = Made(steps=14)
    bag = write_made_bag(
        folder / "bag", typestore, made, lambda topic, step: step == 8 and "camera_front/image" in topic
    )
    return read_frames(survey_bag(bag, "detection", (Need.LIDAR,), folder), "mine")


@pytest.mark.parametrize("row", [0, 3])
def test_returns_between_three_tenths_and_three_metres_above_the_ground(episode: EpisodeFrames, row: int) -> None:
    """Of six returns five are on the car; the road's is at the height of the vehicle's wheels."""
    step = int(episode.step[row])
    points = sweep_of(step)[:5]
    ahead, left = points["x"] + LIDAR_M[0], points["y"]
    cos, sin = np.cos(yaw_of(step)), np.sin(yaw_of(step))
    x_m, y_m, _ = place_of(step)
    expected = np.stack((x_m + ahead * cos - left * sin, y_m + ahead * sin + left * cos), axis=-1)
    assert returns_from_above(episode, row) == pytest.approx(expected, abs=1e-5)


@pytest.mark.parametrize(("lifted_m", "seen"), [(0.29, 5), (0.31, 6), (1.99, 6), (2.01, 4)])
def test_heights_are_above_the_ground_below_the_sensor(episode: EpisodeFrames, lifted_m: float, seen: int) -> None:
    """With the LiDAR higher above the ground by so much all returns are too: 1, 0.75, 0.5, 1, 0.75 and 0 m."""
    higher = episode.base_from_lidar.copy()
    higher[2, 3] += lifted_m
    assert len(returns_from_above(replace(episode, base_from_lidar=higher), 0)) == seen


def test_the_front_cameras_picture_and_where_it_looks(episode: EpisodeFrames) -> None:
    picture = front_picture(episode, 3)
    assert picture is not None
    step = int(episode.step[3])
    assert picture.rgb.shape == (48, 64, 3)
    assert picture.rgb.reshape(-1, 3).mean(axis=0) == pytest.approx([5 * step, 120, 200], abs=3.0)
    # 10 m ahead of the camera and 2 m to its left: that is depth 10 and −2 along its rows.
    cos, sin = np.cos(yaw_of(step)), np.sin(yaw_of(step))
    x_m, y_m, z_m = place_of(step)
    ahead, left = FRONT_M[0] + 10.0, FRONT_M[1] + 2.0
    place = [x_m + ahead * cos - left * sin, y_m + ahead * sin + left * cos, z_m + FRONT_M[2], 1.0]
    assert picture.camera_from_map @ place == pytest.approx([-2.0, 0.0, 10.0, 1.0])
    assert front_picture(episode, 2) is None, "there is none at that step"
    assert front_picture(replace(episode, camera_from_lidar=None), 3) is None
