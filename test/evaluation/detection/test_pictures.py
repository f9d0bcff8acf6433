"""Recorded sweeps and camera pictures behind the boxes."""

from dataclasses import replace

import numpy as np
import pytest
from datasets.made_bag import FRONT_M, LIDAR_M, BagSpec, place_of, sweep_of, write_made_bag, yaw_of
from matplotlib.collections import LineCollection
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from rosbags.typesys.store import Typestore

from siren_ros.evaluation.detection.boxes import Boxes
from siren_ros.evaluation.detection.frames import EpisodeFrames, Frames, read_frames
from siren_ros.evaluation.detection.pictures import (
    FrontPicture,
    draw_in_picture,
    edges_in_picture,
    front_picture,
    returns_from_above,
)
from siren_ros.record.bag_survey import Need, survey_bag
from siren_ros.world.measurements import CameraIntrinsics


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


@pytest.fixture(scope="module")
def episode(tmp_path_factory: pytest.TempPathFactory, typestore: Typestore) -> EpisodeFrames:
    """Five sweeps, at steps 4 to 12; without the front camera's picture at step 8."""
    folder = tmp_path_factory.mktemp("bag")
    made = BagSpec(steps=14)
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


CAMERA_FROM_MAP = np.array([[0, -1.0, 0, 0], [0, 0, -1.0, 1.0], [1.0, 0, 0, 0], [0, 0, 0, 1.0]])
"""A metre above the ground, looking along x."""
PICTURE = FrontPicture(
    np.zeros((600, 800, 3), dtype=np.uint8), CameraIntrinsics(800, 600, 400.0, 400.0, 400.0, 300.0), CAMERA_FROM_MAP
)


def _box(x_m: float, y_m: float, yaw_rad: float) -> Boxes:
    return Boxes(
        frame=np.zeros(1, dtype=np.intp),
        centre_m=np.array([[x_m, y_m, 1.0]]),
        size_m=np.array([[4.0, 2.0, 1.0]]),
        yaw_rad=np.array([yaw_rad]),
        velocity_mps=np.zeros((1, 2)),
        attribute=np.zeros(1, dtype=np.uint8),
    )


@pytest.mark.parametrize(("yaw_rad", "half_length_m", "half_width_m"), [(0.0, 2.0, 1.0), (np.pi / 2.0, 1.0, 2.0)])
def test_corners_are_where_a_pinhole_sees_them(yaw_rad: float, half_length_m: float, half_width_m: float) -> None:
    edges = edges_in_picture(PICTURE, _box(12.0, 3.0, yaw_rad))
    assert edges.shape == (12, 2, 2)
    near, far = 12.0 - half_length_m, 12.0 + half_length_m
    columns = [400.0 - 400.0 * (3.0 + side * half_width_m) / away for away in (near, far) for side in (-1, 1)]
    assert np.unique(edges[..., 0].round(6)) == pytest.approx(sorted(columns))
    assert np.unique(edges[..., 1].round(6)) == pytest.approx(
        sorted(300.0 + sign * 400.0 * 0.5 / away for away in (near, far) for sign in (-1, 1))
    )


def test_what_is_behind_the_camera_is_not_drawn() -> None:
    assert edges_in_picture(PICTURE, _box(-12.0, 0.0, 0.0)).shape == (0, 2, 2)
    assert edges_in_picture(PICTURE, _box(1.0, 0.0, 0.0)).shape == (4, 2, 2)


def test_edges_lie_over_the_picture_in_the_colours_of_their_groups() -> None:
    axes = Figure().add_subplot()
    boxes = {"one": _box(12.0, 3.0, 0.0), "other": _box(20.0, -3.0, 0.5)}
    draw_in_picture(axes, PICTURE, boxes, {"one": "#112233", "other": "#445566"})
    (image,) = axes.images
    assert image.get_array().shape == (600, 800, 3)
    # Rows are counted from the top.
    assert (axes.get_xlim(), axes.get_ylim()) == ((0.0, 800.0), (600.0, 0.0))
    lines = [one for one in axes.collections if isinstance(one, LineCollection)]
    for found, name, colour in zip(lines, boxes, ("#112233", "#445566"), strict=True):
        assert np.array(found.get_segments()) == pytest.approx(edges_in_picture(PICTURE, boxes[name]))
        assert to_hex(found.get_colors()[0]) == colour
    assert not axes.axison


@pytest.mark.parametrize(("rear_m", "edges"), [(0.51, 12), (0.49, 4)])
def test_edges_within_half_a_metre_of_the_lens_are_left_out(rear_m: float, edges: int) -> None:
    """Where the rear is too near, its four edges go, and the four that lead to it."""
    assert len(edges_in_picture(PICTURE, _box(rear_m + 2.0, 0.0, 0.0))) == edges
