"""Recorded sweeps and camera pictures behind the boxes, the worst frame from above, precision over recall."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from datasets.made_bag import FRONT_M, LIDAR_M, BagSpec, place_of, sweep_of, write_made_bag, yaw_of
from drawn_figures import shown
from known_outputs import assert_known
from made_detections import busy_episodes, columns_ahead, found_boxes, made_frames, truth_boxes
from matplotlib.collections import LineCollection
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from rosbags.typesys.store import Typestore

from siren_ros.data.episode_source import Need, survey_bag
from siren_ros.scoring.evaluation.detection import pictures as birdseye
from siren_ros.scoring.evaluation.detection.boxes import Boxes, FoundSet
from siren_ros.scoring.evaluation.detection.frames import EpisodeFrames, Frames, frames_of, read_frames
from siren_ros.scoring.evaluation.detection.metrics import devkit_score, match
from siren_ros.scoring.evaluation.detection.pictures import (
    FrontPicture,
    draw_curves,
    draw_in_picture,
    edges_in_picture,
    front_picture,
    returns_from_above,
)
from siren_ros.scoring.evaluation.detection.scoring import VEHICLE_NAMES, score_detector
from siren_ros.simulation.world.carrier import CameraIntrinsics


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
    assert returns_from_above(replace(episode, step=episode.step + 1_000_001), row).shape == (0, 2), "no sweep"


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


@pytest.mark.parametrize(("rear_m", "edges"), [(0.51, 12), (0.49, 4), (-1.0, 4), (-14.0, 0)])
def test_edges_within_half_a_metre_of_the_lens_and_behind_it_are_left_out(rear_m: float, edges: int) -> None:
    """Where the rear is too near, its four edges go, and the four that lead to it."""
    assert edges_in_picture(PICTURE, _box(rear_m + 2.0, 0.0, 0.0)).shape == (edges, 2, 2)


def test_edges_lie_over_the_picture_in_the_colours_of_their_groups() -> None:
    axes = Figure().add_subplot()
    boxes = {"one": _box(12.0, 3.0, 0.0), "other": _box(20.0, -3.0, 0.5)}
    draw_in_picture(axes, PICTURE, boxes, {"one": "#112233", "other": "#445566"})
    # Rows are counted from the top.
    assert (axes.get_xlim(), axes.get_ylim()) == ((0.0, 800.0), (600.0, 0.0))
    lines = [one for one in axes.collections if isinstance(one, LineCollection)]
    for found, name, colour in zip(lines, boxes, ("#112233", "#445566"), strict=True):
        assert np.array(found.get_segments()) == pytest.approx(edges_in_picture(PICTURE, boxes[name]))
        assert to_hex(found.get_colors()[0]) == colour


@pytest.fixture(autouse=True)
def _own_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def two_templates() -> Frames:
    """Frames 0 to 3 are of S2, 4 to 7 of S3."""
    first, second = made_frames(camera=False).episodes
    return frames_of([first, replace(second, template="S3")])


def drawn(
    labels: list[tuple[int, float]],
    found: list[tuple[int, float, float]],
    template: str,
    path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> dict[str, tuple[int, list[float]]]:
    """Frame and distances ahead of what is drawn, by its name."""
    truth = truth_boxes(*columns_ahead(labels))
    boxes = found_boxes(*columns_ahead([one[:2] for one in found]), np.array([one[2] for one in found]))
    scores: Any = SimpleNamespace(name="made", truth=truth, found=boxes, matches=match(truth, boxes))
    groups: dict[str, tuple[int, list[float]]] = {}

    def kept(_axes: object, some: Boxes, place: np.ndarray, name: str) -> None:
        away = np.hypot(*(some.centre_m[:, :2] - place).T)
        if len(some):
            groups[name] = int(some.frame[0]), np.round(away, 6).tolist()

    monkeypatch.setattr(birdseye, "draw_boxes", kept)
    monkeypatch.setattr(birdseye, "returns_from_above", lambda *_: np.zeros((1, 2)))
    birdseye.draw_worst_frame(scores, two_templates(), template, path)
    assert path.stat().st_size > 1000
    return groups


def test_the_frame_with_the_most_errors_is_drawn(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Frame 1 has a miss and a false alarm, frame 2 one miss; frame 3 has no label; those of S3 do not count."""
    labels = [(0, 10.0), (1, 10.0), (1, 20.0), (2, 10.0), (5, 10.0), (5, 20.0), (5, 30.0)]
    found = [
        (0, 10.0, 0.9),
        (1, 10.5, 0.8),
        (1, 30.0, 0.7),
        (1, 40.0, 0.29),
        *((3, 5.0 * place, 0.9) for place in range(1, 6)),
        (5, 10.0, 0.31),
        (5, 20.0, 0.29),
    ]
    assert drawn(labels, found, "S2", Path("a.png"), monkeypatch) == {
        "label, found": (1, [10.0]),
        "label, missed": (1, [20.0]),
        "hit": (1, [10.5]),
        "false alarm": (1, [30.0]),
    }
    # A faint detection is left out, and the label that it would have taken is missed.
    assert drawn(labels, found, "S3", tmp_path / "b.png", monkeypatch) == {
        "label, found": (5, [10.0]),
        "label, missed": (5, [20.0, 30.0]),
        "hit": (5, [10.0]),
    }


def test_matches_are_within_two_metres_and_the_first_of_equal_frames_is_drawn(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    labels, found = [(6, 10.0), (7, 10.0)], [(6, 11.9, 0.9), (7, 12.1, 0.9)]
    assert drawn(labels, found, "S3", Path("a.png"), monkeypatch)["label, missed"] == (7, [10.0])
    alike = [(4, 10.0), (6, 10.0), (7, 10.0)]
    assert drawn(alike, [(7, 10.0, 0.9)], "S3", tmp_path / "b.png", monkeypatch) == {"label, missed": (4, [10.0])}


def test_everything_that_the_pictures_of_a_busy_episode_show(
    monkeypatch: pytest.MonkeyPatch, figures: list[Figure]
) -> None:
    frames, boxes = busy_episodes("S1 S2", 12)
    given = FoundSet("made", "made", boxes, frames.scored, has_velocity=True)
    scores = score_detector(frames, given, VEHICLE_NAMES, lambda tables: [devkit_score(*one) for one in tables])

    def picture(episode: EpisodeFrames, row: int) -> FrontPicture | None:
        if episode.camera_from_lidar is None or episode.template == "S2":
            return None
        camera_from_map = episode.camera_from_lidar @ np.linalg.inv(episode.map_from_lidar[row])
        rgb = np.arange(64 * 48 * 3, dtype=np.uint8).reshape(48, 64, 3)
        return FrontPicture(rgb, CameraIntrinsics.centred(64, 48, 40.0), camera_from_map)

    monkeypatch.setattr(birdseye, "front_picture", picture)
    monkeypatch.setattr(birdseye, "returns_from_above", lambda episode, row: episode.vehicle_m[row] + np.eye(2))
    for template in ("S1", "S2"):
        birdseye.draw_worst_frame(scores, frames, template, Path(f"{template}.png"))
    draw_curves(scores, Path("curves.png"))
    found = [shown(figure) for figure in figures]
    assert_known(Path(__file__).parent / "known" / "pictures.json", found, digits=4, decimals=2)
