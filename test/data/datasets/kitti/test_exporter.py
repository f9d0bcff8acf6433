"""KITTI's files of three episodes of formulas, one of which is for test: numbers, places, calibration, tables."""

import csv
import io
import json
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from datasets.made_bag import BUS, CAR, FRONT, FRONT_M, LIDAR_M, jpeg_of, sweep_of, truth_of
from PIL import Image
from reader_environments import read_with

from siren_ros.cli.main import main
from siren_ros.data.datasets.kitti.labels import label_text
from siren_ros.data.interfaces.boxes import from_ground_truth
from siren_ros.data.interfaces.measurements import from_point_cloud
from siren_ros.data.interfaces.topics import GROUND_TRUTH
from siren_ros.data.record.episode_source import open_source
from siren_ros.simulation.world.carrier import GroundTruth

DATASET = ("kitti", "sensed_bag")
MADE_DATASET = ("kitti", "made_bags")
SWEEPS = {0: 19, 1: 10, 2: 10}
"""By seed."""
LIDAR = "/emv/lidar/points"
FRAMES = (0, 10, 19)
"""The first, the middle and the last one."""


@pytest.fixture(scope="module")
def frames(made_dataset: Path) -> list[dict[str, str]]:
    return list(csv.DictReader(io.StringIO((made_dataset / "frames.csv").read_text())))


def seed_of(frame: dict[str, str]) -> int:
    return int(frame["episode"].split("_seed")[1].split("_")[0])


def set_of(made_dataset: Path, name: str) -> list[str]:
    return (made_dataset / "ImageSets" / f"{name}.txt").read_text().split()


def folder_of(made_dataset: Path, number: str) -> Path:
    return made_dataset / ("testing" if number in set_of(made_dataset, "test") else "training")


def test_frames_of_all_episodes_are_numbered_in_one_row(frames):
    """The first sweep is at step 4 and each is two steps after the one before."""
    assert [frame["frame"] for frame in frames] == [f"{number:06d}" for number in range(39)]
    for seed, count in SWEEPS.items():
        of_seed = [frame for frame in frames if seed_of(frame) == seed]
        assert [int(frame["step"]) for frame in of_seed] == list(range(4, 4 + 2 * count, 2))
        assert [float(frame["timestamp"]) for frame in of_seed] == pytest.approx(0.05 * np.arange(4, 4 + 2 * count, 2))
        assert [frame["episode"] for frame in of_seed] == [f"S2_L2_seed{seed}_straight"] * count
    assert [seed_of(frame) for frame in frames] == sorted(map(seed_of, frames))


def test_one_episode_is_for_test_and_one_for_validation(made_dataset, frames):
    splits = {name: set_of(made_dataset, name) for name in ("train", "val", "test", "trainval")}
    assert sorted([*splits["train"], *splits["val"], *splits["test"]]) == [frame["frame"] for frame in frames]
    assert splits["trainval"] == sorted([*splits["train"], *splits["val"]])
    for name in ("train", "val", "test"):
        seeds = {seed_of(frame) for frame in frames if frame["frame"] in splits[name]}
        assert len(seeds) == 1, "whole episodes"
        assert len(splits[name]) == SWEEPS[seeds.pop()]
    for home, names in (("testing", splits["test"]), ("training", splits["trainval"])):
        for folder, suffix in (("velodyne", "bin"), ("image_2", "png"), ("calib", "txt"), ("label_lidar", "txt")):
            files = sorted(path.name for path in (made_dataset / home / folder).iterdir())
            assert files == [f"{number}.{suffix}" for number in names]


@pytest.mark.parametrize("row", [0, 7, 18, 19, 28, 38])
def test_a_frames_files_are_those_of_its_step(made_dataset, frames, row):
    number, step = frames[row]["frame"], int(frames[row]["step"])
    folder, points = folder_of(made_dataset, number), sweep_of(step)
    read = np.fromfile(folder / "velodyne" / f"{number}.bin", dtype="<f4").reshape(-1, 4)
    for column, name in enumerate(("x", "y", "z", "intensity")):
        assert read[:, column].tolist() == points[name].tolist()
    with (
        Image.open(folder / "image_2" / f"{number}.png") as picture,
        Image.open(io.BytesIO(jpeg_of(step, FRONT))) as recorded,
    ):
        assert np.asarray(picture)[0, 0].tolist() == pytest.approx(np.asarray(recorded)[0, 0].tolist(), abs=2)
    assert (folder / "label_lidar" / f"{number}.txt").read_text() == label_text(truth_of(step))


def test_the_calibration_is_that_of_the_mounts(made_dataset):
    calib = folder_of(made_dataset, "000000") / "calib" / "000000.txt"
    lines = dict(line.split(": ") for line in calib.read_text().splitlines())
    matrix = np.array(lines["Tr_velo_to_cam"].split(), dtype=float).reshape(3, 4)
    # A point 10 m ahead of the LiDAR, 3 m to its left, at its height.
    ahead_m, up_m = LIDAR_M[0] + 10.0 - FRONT_M[0], LIDAR_M[2] - FRONT_M[2]
    assert matrix @ [10.0, 3.0, 0.0, 1.0] == pytest.approx([-3.0, -up_m, ahead_m])
    assert [float(word) for word in lines["P2"].split()] == [32.0, 0, 32, 0, 0, 32, 24, 0, 0, 0, 1, 0]
    assert len({lines[f"P{index}"] for index in range(4)}) == 1
    assert [float(word) for word in lines["R0_rect"].split()] == np.eye(3).reshape(-1).tolist()


def test_objects_name_the_actors_behind_the_labels(made_dataset, frames):
    """The car stands in the picture at every frame, the bus behind the camera at none."""
    rows = list(csv.DictReader(io.StringIO((made_dataset / "objects.csv").read_text())))
    assert [row["frame"] for row in rows] == [frame["frame"] for frame in frames]
    assert {(row["line"], row["actor_id"], row["type"], row["is_emv"], row["lidar_points"]) for row in rows} == {
        ("0", str(CAR), "Car", "0", "5")
    }
    assert {row["lidar_visibility"] for row in rows} == {"1.000"}
    assert str(BUS) not in {row["actor_id"] for row in rows}
    number = frames[20]["frame"]
    words = (folder_of(made_dataset, number) / "label_2" / f"{number}.txt").read_text().split()
    assert (words[0], len(words)) == ("Car", 15)
    assert [float(word) for word in words[11:14]] == pytest.approx([-3.0, 1.25 + 0.75 - 0.5, 11.0])


def test_in_the_papers_layout_the_frames_are_numbered_likewise(exported, made_bags):
    out = exported("kitti", made_bags, "--layout", "paper")
    names = [f"{number:06d}" for number in range(39)]
    for folder, suffix in (("velodyne", "bin"), ("label_2", "txt"), ("image_2", "jpg"), ("calib", "txt")):
        assert sorted(path.name for path in (out / folder).iterdir()) == [f"{name}.{suffix}" for name in names]
    assert (out / "image_2" / "000019.jpg").read_bytes() == jpeg_of(4, FRONT)
    assert (out / "label_2" / "000001.txt").read_text() == label_text(truth_of(6))
    assert not (out / "ImageSets").exists()
    text = (out / "README.md").read_text()
    assert text.startswith("# The paper's layout, which is not KITTI's")
    assert "# SIREN dataset, format kitti" in text
    assert len((out / "frames.csv").read_text().splitlines()) == 40


@pytest.fixture(scope="module")
def read(dataset: Path) -> dict[str, Any]:
    """What Open3D-ML finds in each of the frames."""
    names = [f"{frame:06d}" for frame in FRAMES]
    return read_with("open3d_ml", "read_kitti.py", dataset / "training", *names)


@pytest.fixture(scope="module")
def truths(sensed_bag: Path) -> dict[int, tuple[GroundTruth, npt.NDArray[np.void]]]:
    """Ground truth and sweep by frame number."""
    by_frame = {}
    with open_source(sensed_bag) as source:
        for step, held in source.messages_by_step({LIDAR, GROUND_TRUTH.name}):
            if GROUND_TRUTH.name in held:
                truth = from_ground_truth(held[GROUND_TRUTH.name].read())
                by_frame[step // 2] = truth, from_point_cloud(held[LIDAR].read()).copy()
    return by_frame


def _objects(made_dataset: Path, frame: int) -> list[dict[str, str]]:
    head, *rows = (line.split(",") for line in (made_dataset / "objects.csv").read_text().splitlines())
    return [dict(zip(head, row, strict=True)) for row in rows if int(row[0]) == frame]


def test_the_layout_is_the_benchmarks(dataset):
    assert sorted(path.name for path in dataset.iterdir()) == [
        "ImageSets",
        "README.md",
        "croissant.json",
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
def test_a_reader_of_others_finds_the_vehicles(dataset, read, truths, frame):
    in_frame = read[f"{frame:06d}"]
    truth, points = truths[frame]
    assert in_frame["points"] > 0.2 * len(points), "Open3D-ML may keep what the camera sees"
    rows = {int(key): row for row, key in enumerate(truth.actor_id.tolist())}
    objects = _objects(dataset, frame)
    assert len(in_frame["boxes"]) == len(objects) > 2
    for box, entry in zip(in_frame["boxes"], objects, strict=True):
        row = rows[int(entry["actor_id"])]
        assert box["centre"] == pytest.approx((truth.x_m[row], truth.y_m[row], truth.z_m[row]), abs=2e-4)
        size = (truth.width_m[row], truth.height_m[row], truth.length_m[row])
        assert box["size_whl"] == pytest.approx(size, abs=1e-4)


@pytest.mark.parametrize("frame", FRAMES)
def test_boxes_hold_the_points_that_hit_their_vehicle(dataset, truths, frame):
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
        hits = points["instance"] == int(entry["actor_id"])
        assert inside[hits].all()
        assert points["instance"][inside & ~hits].tolist() == [0] * int((inside & ~hits).sum())
        assert int(entry["lidar_points"]) == hits.sum()
        assert (int(words[2]) == 3) == (hits.sum() == 0), "a box without a point is marked"


def test_projections_lie_in_the_boxes_of_the_picture(dataset, truths):
    _, points = truths[15]
    calib = (dataset / "training" / "calib" / "000015.txt").read_text().splitlines()
    p2 = np.fromstring(calib[2].split(": ")[1], sep=" ").reshape(3, 4)
    to_camera = np.vstack((np.fromstring(calib[5].split(": ")[1], sep=" ").reshape(3, 4), [0, 0, 0, 1]))
    lines = (dataset / "training" / "label_2" / "000015.txt").read_text().splitlines()
    hits = 0
    for line, entry in zip(lines, _objects(dataset, 15), strict=True):
        returns = points[points["instance"] == int(entry["actor_id"])]
        seen = p2 @ to_camera @ np.stack((returns["x"], returns["y"], returns["z"], np.ones(len(returns))))
        u, v = seen[:2] / seen[2]
        inside = (seen[2] > 0.1) & (u >= 0) & (u < 799) & (v >= 0) & (v < 599)
        left, top, right, bottom = (float(word) for word in line.split()[4:8])
        assert ((u[inside] >= left - 0.5) & (u[inside] <= right + 0.5)).all()
        assert ((v[inside] >= top - 0.5) & (v[inside] <= bottom + 0.5)).all()
        hits += int(inside.sum())
    assert hits > 100


def test_the_card_counts_what_is_there(dataset):
    card = json.loads((dataset / "dataset.json").read_text())
    assert card["counts"]["frames"] == 20
    lines = sum(len(path.read_text().splitlines()) for path in (dataset / "training" / "label_2").iterdir())
    assert card["counts"]["labels"] == lines == sum(card["classes"].values())


def test_a_suite_without_a_camera_is_refused_with_the_command(tmp_path, capsys, tracked_bag):
    assert main(["export", "kitti", str(tracked_bag), "--out", str(tmp_path / "out")]) == 2
    text = capsys.readouterr().err
    assert "a LiDAR with its ground truth and a front camera" in text
    assert "ros2 run siren_ros cosim --ros-args -p template:=S3" in text
    assert list(tmp_path.iterdir()) == []
