"""KITTI as a reader of others reads it, and against the geometry of the episode."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from PIL import Image
from reader_environments import read_with

from siren_ros.cli.main import main
from siren_ros.datasets.sources.episode_source import open_source
from siren_ros.interfaces.boxes import from_ground_truth
from siren_ros.interfaces.point_cloud import from_point_cloud
from siren_ros.interfaces.topics import GROUND_TRUTH
from siren_ros.world.ground_truth import GroundTruth

LIDAR = "/emv/lidar/points"
FRAMES = (0, 10, 19)
"""The first, the middle and the last one."""


@pytest.fixture(scope="module")
def dataset(sensed_bag: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("kitti") / "out"
    assert main(["export", "kitti", str(sensed_bag), "--out", str(out)]) == 0
    return out


@pytest.fixture(scope="module")
def read(dataset: Path) -> dict[str, Any]:
    """What Open3D-ML finds in each of the frames."""
    names = [f"{frame:06d}" for frame in FRAMES]
    found: dict[str, Any] = read_with("open3d_ml", "read_kitti.py", dataset / "training", *names)
    return found


@pytest.fixture(scope="module")
def truths(sensed_bag: Path) -> dict[int, tuple[GroundTruth, npt.NDArray[np.void]]]:
    """Ground truth and sweep by frame number."""
    found = {}
    with open_source(sensed_bag) as source:
        for step, held in source.messages_by_step({LIDAR, GROUND_TRUTH.name}):
            if GROUND_TRUTH.name in held:
                truth = from_ground_truth(held[GROUND_TRUTH.name].read())
                found[step // 2] = truth, from_point_cloud(held[LIDAR].read()).copy()
    return found


def _objects(dataset: Path, frame: int) -> list[dict[str, str]]:
    head, *rows = (line.split(",") for line in (dataset / "objects.csv").read_text().splitlines())
    return [dict(zip(head, row, strict=True)) for row in rows if int(row[0]) == frame]


def test_the_layout_is_the_benchmarks(dataset: Path) -> None:
    assert sorted(path.name for path in dataset.iterdir()) == [
        "ImageSets",
        "README.md",
        "dataset.json",
        "frames.csv",
        "objects.csv",
        "training",
    ]
    for folder, suffix in (("velodyne", "bin"), ("image_2", "png"), ("calib", "txt"), ("label_2", "txt")):
        names = sorted(path.name for path in (dataset / "training" / folder).iterdir())
        assert names == [f"{number:06d}.{suffix}" for number in range(20)]
    assert (dataset / "ImageSets" / "train.txt").read_text().split() == [f"{number:06d}" for number in range(20)]
    with Image.open(dataset / "training" / "image_2" / "000004.png") as picture:
        picture.load()
        assert (picture.size, picture.mode) == ((800, 600), "RGB")


@pytest.mark.parametrize("frame", FRAMES)
def test_a_reader_of_others_finds_the_vehicles(
    dataset: Path, read: dict[str, Any], truths: dict[int, tuple[GroundTruth, npt.NDArray[np.void]]], frame: int
) -> None:
    found = read[f"{frame:06d}"]
    truth, points = truths[frame]
    assert found["points"] > 0.2 * len(points), "Open3D-ML may keep what the camera sees"
    rows = {int(key): row for row, key in enumerate(truth.actor_id.tolist())}
    objects = _objects(dataset, frame)
    assert len(found["boxes"]) == len(objects) > 2
    for box, entry in zip(found["boxes"], objects, strict=True):
        row = rows[int(entry["actor_id"])]
        assert box["centre"] == pytest.approx((truth.x_m[row], truth.y_m[row], truth.z_m[row]), abs=2e-4)
        size = (truth.width_m[row], truth.height_m[row], truth.length_m[row])
        assert box["size_whl"] == pytest.approx(size, abs=1e-4)


@pytest.mark.parametrize("frame", FRAMES)
def test_boxes_hold_the_points_that_hit_their_vehicle(
    dataset: Path, truths: dict[int, tuple[GroundTruth, npt.NDArray[np.void]]], frame: int
) -> None:
    """By OpenPCDet's rules: bottom centre from the camera to the LiDAR, heading −(rotation_y + π/2)."""
    truth, points = truths[frame]
    training = dataset / "training"
    lines = (training / "label_2" / f"{frame:06d}.txt").read_text().splitlines()
    calib = dict(line.split(": ") for line in (training / "calib" / f"{frame:06d}.txt").read_text().splitlines())
    camera_from_lidar = np.vstack((np.fromstring(calib["Tr_velo_to_cam"], sep=" ").reshape(3, 4), [0, 0, 0, 1]))
    xyz = np.fromfile(training / "velodyne" / f"{frame:06d}.bin", dtype="<f4").reshape(-1, 4)[:, :3].astype(float)
    assert len(xyz) == len(points)
    for line, entry in zip(lines, _objects(dataset, frame), strict=True):
        words = line.split()
        h, w, length, *bottom, rotation = (float(word) for word in words[8:])
        centre = (np.linalg.inv(camera_from_lidar) @ [*bottom, 1.0])[:3]
        centre[2] += h / 2
        row = truth.actor_id.tolist().index(int(entry["actor_id"]))
        heading = -(rotation + np.pi / 2)
        assert np.cos(heading - truth.yaw_rad[row]) == pytest.approx(1.0, abs=1e-7)
        offset = xyz - centre
        along = offset[:, 0] * np.cos(heading) + offset[:, 1] * np.sin(heading)
        across = offset[:, 1] * np.cos(heading) - offset[:, 0] * np.sin(heading)
        margin = 1e-2
        inside = (abs(along) <= length / 2 + margin) & (abs(across) <= w / 2 + margin)
        inside &= abs(offset[:, 2]) <= h / 2 + margin
        own = points["instance"] == int(entry["actor_id"])
        assert (inside[own]).all()
        assert points["instance"][inside & ~own].tolist() == [0] * int((inside & ~own).sum())
        assert int(entry["lidar_points"]) == own.sum()
        assert (int(words[2]) == 3) == (own.sum() == 0), "a box without a point is marked"


def test_projections_lie_in_the_boxes_of_the_picture(
    dataset: Path, truths: dict[int, tuple[GroundTruth, npt.NDArray[np.void]]]
) -> None:
    _, points = truths[15]
    calib = (dataset / "training" / "calib" / "000015.txt").read_text().splitlines()
    p2 = np.fromstring(calib[2].split(": ")[1], sep=" ").reshape(3, 4)
    to_camera = np.vstack((np.fromstring(calib[5].split(": ")[1], sep=" ").reshape(3, 4), [0, 0, 0, 1]))
    lines = (dataset / "training" / "label_2" / "000015.txt").read_text().splitlines()
    hits = 0
    for line, entry in zip(lines, _objects(dataset, 15), strict=True):
        own = points[points["instance"] == int(entry["actor_id"])]
        seen = p2 @ to_camera @ np.stack((own["x"], own["y"], own["z"], np.ones(len(own))))
        u, v = seen[:2] / seen[2]
        inside = (seen[2] > 0.1) & (u >= 0) & (u < 799) & (v >= 0) & (v < 599)
        left, top, right, bottom = (float(word) for word in line.split()[4:8])
        assert ((u[inside] >= left - 0.5) & (u[inside] <= right + 0.5)).all()
        assert ((v[inside] >= top - 0.5) & (v[inside] <= bottom + 0.5)).all()
        hits += int(inside.sum())
    assert hits > 100


def test_the_card_counts_what_is_there(dataset: Path) -> None:
    card = json.loads((dataset / "dataset.json").read_text())
    assert card["counts"]["frames"] == 20
    lines = sum(len(path.read_text().splitlines()) for path in (dataset / "training" / "label_2").iterdir())
    assert card["counts"]["labels"] == lines == sum(card["classes"].values())


def test_a_suite_without_a_camera_is_refused_with_the_command(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], tracked_bag: Path
) -> None:
    assert main(["export", "kitti", str(tracked_bag), "--out", str(tmp_path / "out")]) == 2
    told = capsys.readouterr().err
    assert "a LiDAR with its ground truth and a front camera" in told
    assert "ros2 run siren_ros cosim --ros-args -p template:=S3" in told
    assert list(tmp_path.iterdir()) == []
