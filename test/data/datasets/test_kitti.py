"""KITTI's files: labels of one car written out, frames, and three episodes of formulas, one of which is for test."""

import csv
import io
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
import simplejpeg
from datasets.made_bag import BUS, CAR, FRONT, FRONT_M, LIDAR_M, jpeg_of, sweep_of, truth_of
from PIL import Image
from reader_environments import read_with
from synthetic_episode import Scene, SyntheticEpisode

from siren_ros.base.numerics.geometry import wrap_angle
from siren_ros.cli.main import main
from siren_ros.data.datasets.files import FileWriter
from siren_ros.data.datasets.kitti import (
    TYPE_OF_CLASS,
    CameraLabels,
    KittiCamera,
    KittiFrame,
    KittiFrames,
    calibration_text,
    camera_from_lidar,
    camera_labels,
    label_lines,
    label_text,
    png_bytes,
    png_of_jpeg,
    velodyne_bytes,
)
from siren_ros.data.episode_source import open_source
from siren_ros.data.interfaces.boxes import from_ground_truth
from siren_ros.data.interfaces.measurements import Transform, from_point_cloud, quaternion_of_matrix
from siren_ros.data.interfaces.topics import GROUND_TRUTH
from siren_ros.errors import InputError
from siren_ros.simulation.scenario.episode import KittiLayout
from siren_ros.simulation.world.actors import ActorClass
from siren_ros.simulation.world.carrier import CameraIntrinsics, GroundTruth

LENGTH_M, WIDTH_M, HEIGHT_M = 4.0, 1.8, 1.5
CAMERA = KittiCamera(
    CameraIntrinsics(800, 600, 400.0, 400.0, 400.0, 300.0),
    np.array([[0.0, -1.0, 0, 0], [0, 0, -1.0, -0.5], [1.0, 0, 0, -1.5], [0, 0, 0, 1.0]]),
)
"""1.5 m ahead of the LiDAR and 0.5 m below it; right, down, ahead."""
POINT = np.dtype([("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("instance", "<u2")])


def a_van(x_m: float, y_m: float, yaw_rad: float, lidar_points: int = 10) -> GroundTruth:
    """A van whose centre is 1 m below the LiDAR."""
    pose = {name: np.array([value]) for name, value in (("x_m", x_m), ("y_m", y_m), ("yaw_rad", yaw_rad))}
    return GroundTruth(
        step=3,
        carrier_id=1,
        actor_id=np.array([5], dtype=np.uint32),
        actor_class=np.array([ActorClass.VAN], dtype=np.uint8),
        is_emv=np.array([False]),
        z_m=np.array([-1.0]),
        length_m=np.array([LENGTH_M]),
        width_m=np.array([WIDTH_M]),
        height_m=np.array([HEIGHT_M]),
        vx_mps=np.zeros(1),
        vy_mps=np.zeros(1),
        accel_mps2=np.zeros(1),
        lidar_points=np.array([lidar_points], dtype=np.uint32),
        **pose,
    )


def labels_of(truth: GroundTruth, before: int = 0) -> CameraLabels:
    """With some returns half way to the box."""
    points = np.zeros(before, dtype=POINT)
    points["x"], points["y"], points["z"] = truth.x_m[0] / 2.0, truth.y_m[0] / 2.0, truth.z_m[0] / 2.0
    return camera_labels(truth, points, CAMERA)


@pytest.mark.parametrize("y_m", [4.0, -6.0])
def test_the_place_is_the_middle_of_the_bottom_in_the_cameras_frame(y_m):
    labels = labels_of(a_van(20.0, y_m, 0.4))
    # To the right, down, ahead; the bottom is half a height below the centre.
    assert labels.bottom_m == pytest.approx(np.array([[-y_m, 1.0 + 0.75 - 0.5, 18.5]]))
    assert labels.size_m.tolist() == [[HEIGHT_M, WIDTH_M, LENGTH_M]]
    assert labels.types() == ["Van"]


@pytest.mark.parametrize("yaw_rad", [0.0, 0.4, np.pi / 2.0, -2.0, 3.0])
def test_angles_are_from_the_cameras_right(yaw_rad):
    """Ahead is −π/2; alpha is without the direction in which the box is seen, here 4 m to the left at 18.5 m."""
    labels = labels_of(a_van(20.0, 4.0, yaw_rad))
    expected = wrap_angle(-yaw_rad - np.pi / 2.0)
    assert labels.rotation_rad[0] == pytest.approx(expected)
    alpha = float(label_lines(labels).split()[3])
    assert alpha == pytest.approx(wrap_angle(expected - np.arctan2(-4.0, 18.5)), abs=1e-4)


def test_the_box_in_the_picture_is_that_of_its_nearest_corners():
    """A car straight ahead: its rear is 16.5 m before the camera, 0.9 m to each side, 0.25 m above to 1.25 m below."""
    labels = labels_of(a_van(20.0, 0.0, 0.0))
    left, right = 400.0 - 400.0 * 0.9 / 16.5, 400.0 + 400.0 * 0.9 / 16.5
    # The top is 0.25 m above the LiDAR's centre … 0.5 m below it is the camera: −0.25 + 0.5 = 0.25 m above that.
    top, bottom = 300.0 + 400.0 * (1.0 - 0.75 - 0.5) / 16.5, 300.0 + 400.0 * (1.0 + 0.75 - 0.5) / 16.5
    assert labels.box_px[0] == pytest.approx([left, top, right, bottom])
    assert labels.truncated[0] == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize(
    ("returns", "before", "state"), [(10, 0, 0), (8, 2, 0), (7, 3, 1), (4, 6, 1), (3, 7, 2), (1, 9, 2), (0, 0, 3)]
)
def test_occlusion_is_the_share_of_returns_before_the_box(returns, before, state):
    labels = labels_of(a_van(20.0, 4.0, 0.0, returns), before)
    assert labels.occluded.tolist() == [state]
    assert labels.visible[0] == pytest.approx(returns / max(returns + before, 1))


def test_a_car_behind_has_no_label():
    assert len(labels_of(a_van(-20.0, 0.0, 0.0))) == 0
    assert label_lines(labels_of(a_van(-20.0, 0.0, 0.0))) == ""


def test_a_line_has_kittis_fifteen_words():
    words = label_lines(labels_of(a_van(20.0, 4.0, 0.4))).split()
    assert len(words) == 15
    assert words[:3] == ["Van", "0.00", "0"]
    assert [float(word) for word in words[8:]] == pytest.approx(
        [1.5, 1.8, 4.0, -4.0, 1.25, 18.5, float(wrap_angle(-0.4 - np.pi / 2.0))], abs=1e-4
    )


def test_the_calibration_has_the_projection_four_times_and_the_lidars_mount():
    rows = dict(line.split(": ") for line in calibration_text(CAMERA).splitlines())
    assert list(rows) == ["P0", "P1", "P2", "P3", "R0_rect", "Tr_velo_to_cam", "Tr_imu_to_velo"]
    numbers = {name: np.array([float(word) for word in row.split()]) for name, row in rows.items()}
    assert len({rows[f"P{index}"] for index in range(4)}) == 1
    point = np.array([2.0, 1.0, 10.0, 1.0])
    u, v, w = numbers["P2"].reshape(3, 4) @ point
    assert (u / w, v / w) == pytest.approx((400.0 + 400.0 * 0.2, 300.0 + 400.0 * 0.1))
    assert numbers["Tr_velo_to_cam"].reshape(3, 4) == pytest.approx(CAMERA.camera_from_lidar[:3])
    assert numbers["R0_rect"].reshape(3, 3).tolist() == np.eye(3).tolist()
    assert numbers["Tr_imu_to_velo"].reshape(3, 4).tolist() == np.eye(4)[:3].tolist()


def test_every_class_has_kittis_nearest_one():
    names: dict[str, set[str]] = {}
    for kind in ActorClass:
        names.setdefault(TYPE_OF_CLASS[kind], set()).add(kind.name)
    assert names == {
        "Car": {"HATCHBACK", "SEDAN", "ESTATE", "SUV", "PICKUP", "POLICE"},
        "Van": {"VAN", "AMBULANCE"},
        "Truck": {"TRUCK", "FIRE_TRUCK"},
        "Misc": {"BUS", "MOTORCYCLE"},
        "Cyclist": {"BICYCLE"},
        "Pedestrian": {"PEDESTRIAN"},
    }


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


INTRINSICS = CameraIntrinsics(800, 600, 335.64, 335.64, 400.0, 300.0)
BASE_FROM_OPTICAL = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
MOUNTS = (
    Transform("base_link", "lidar", (0.0, 0.0, 1.93), (0.0, 0.0, 0.0, 1.0)),
    Transform("base_link", "camera_front_optical_frame", (2.5, 0.0, 1.0), quaternion_of_matrix(BASE_FROM_OPTICAL)),
)


@pytest.mark.parametrize("shape", [(1, 1, 3), (5, 7, 3), (60, 80, 3)])
def test_another_reader_sees_the_same_pixels(shape):
    rgb = np.random.default_rng(0).integers(0, 256, shape, dtype=np.uint8)
    with Image.open(io.BytesIO(png_bytes(rgb))) as picture:
        picture.load()
        assert np.array_equal(np.asarray(picture), rgb)


def test_a_jpeg_is_decoded_once_and_kept():
    rgb = np.full((16, 16, 3), (200, 30, 90), dtype=np.uint8)
    jpeg = simplejpeg.encode_jpeg(rgb, quality=95)
    with Image.open(io.BytesIO(png_of_jpeg(jpeg))) as picture:
        assert np.array_equal(np.asarray(picture), simplejpeg.decode_jpeg(jpeg))


def _numbers(line: str) -> list[float]:
    return [float(word) for word in line.split()[1:]]


def test_points_are_x_y_z_intensity():
    points = SyntheticEpisode().sweep(3)
    read = np.frombuffer(velodyne_bytes(points), dtype="<f4").reshape(-1, 4)
    assert read.shape == (300, 4)
    assert np.array_equal(read[:, 0], points["x"])
    assert np.array_equal(read[:, 3], points["intensity"])


def test_points_without_intensity_are_refused():
    with pytest.raises(InputError, match="intensity"):
        velodyne_bytes(np.zeros(2, dtype=[("x", "f4"), ("y", "f4"), ("z", "f4")]))


def test_a_label_is_the_box_in_the_lidar_frame():
    truth = SyntheticEpisode().ground_truth(60)
    lines = label_text(truth).splitlines()
    assert len(lines) == 3
    assert lines[0].split()[0] == "Car"
    assert len(lines[0].split()) == 15
    assert lines[0].split()[1:3] == ["0.00", "0"]
    assert _numbers(lines[0])[3:7] == [0.0, 0.0, 0.0, 0.0], "no box in a picture"
    height, width, length, x, y, z, heading = _numbers(lines[0])[7:]
    assert (height, width, length) == pytest.approx((1.45, 1.8, 4.6))
    # At 3 s the EMV is at x = 52, the first civilian at x = 58 and on its way to the left.
    assert (x, z) == pytest.approx((6.0, 1.45 / 2 - 1.93), abs=1e-4)
    assert y > 0.0
    assert heading > 0.0
    assert _numbers(lines[0])[2] == pytest.approx(heading - np.arctan2(y, x), abs=1e-3)


def test_the_lateral_axis_and_the_heading_are_carlas_negated():
    episode = SyntheticEpisode()
    truth, states = episode.ground_truth(60), episode.states(60)
    carla_y, carla_yaw = -states.y_m, -states.yaw_rad
    *_, y, _, heading = _numbers(label_text(truth).splitlines()[0])
    assert y == pytest.approx(-(carla_y[1] - carla_y[0]), abs=1e-4)
    assert heading == pytest.approx(-(carla_yaw[1] - carla_yaw[0]), abs=1e-4)


def test_objects_beyond_50_m_are_dropped():
    truth = SyntheticEpisode().ground_truth(0)
    assert truth.x_m.tolist() == [30.0, 45.0, 60.0, 75.0]
    assert len(label_text(truth).splitlines()) == 2
    moved = replace(truth, x_m=np.full(4, 30.0), y_m=np.array([40.0, -40.0, 40.1, -40.1]))
    assert len(label_text(moved).splitlines()) == 2


def test_the_camera_stands_where_the_tree_puts_it():
    matrix = camera_from_lidar(MOUNTS, "lidar", "camera_front_optical_frame")
    # A point 10 m ahead of the LiDAR at its height: 7.5 m ahead of the camera, 0.93 m above it.
    assert matrix @ [10.0, 0.0, 0.0, 1.0] == pytest.approx([0.0, -0.93, 7.5, 1.0])
    assert matrix @ [10.0, 2.0, 0.0, 1.0] == pytest.approx([-2.0, -0.93, 7.5, 1.0])


@pytest.mark.parametrize(("lidar", "camera"), [("nothing", "lidar"), ("lidar", "nothing")])
def test_an_unknown_frame_is_named(lidar, camera):
    with pytest.raises(InputError, match="nothing"):
        camera_from_lidar(MOUNTS, lidar, camera)


def test_frames_with_different_parents_are_refused():
    with pytest.raises(InputError, match="parent"):
        camera_from_lidar((MOUNTS[0], replace(MOUNTS[1], parent="map")), "lidar", MOUNTS[1].child)


def _live(folder: Path, layout: KittiLayout, jpeg: bytes | None, camera: KittiCamera | None) -> KittiFrames:
    episode = SyntheticEpisode(Scene(duration_s=1.0, lidar=True))
    folder.mkdir()
    with FileWriter(folder) as files:
        frames = KittiFrames(files, layout, camera)
        for step in range(0, 20, 2):
            frames.write(KittiFrame(step, episode.sweep(step), episode.ground_truth(step), jpeg))
    return frames


def _names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_the_papers_layout_says_what_it_is(tmp_path):
    camera = KittiCamera(INTRINSICS, camera_from_lidar(MOUNTS, "lidar", MOUNTS[1].child))
    assert _live(tmp_path / "out", KittiLayout.PAPER, b"a picture", camera).frames == 10
    out = tmp_path / "out"
    assert _names(out) == ["README.md", "calib", "frames.csv", "image_2", "label_2", "velodyne"]
    assert (out / "image_2" / "000003.jpg").read_bytes() == b"a picture"
    assert (out / "frames.csv").read_text().splitlines()[1:3] == ["000000,0,0.00", "000001,2,0.10"]
    assert "Tr_velo_to_cam: 0.00000000 -1.00000000 0.00000000" in (out / "calib" / "000000.txt").read_text()
    assert "not KITTI" in (out / "README.md").read_text()
    assert (out / "label_2" / "000000.txt").read_text() == label_text(SyntheticEpisode().ground_truth(0))


def test_the_papers_layout_needs_no_camera(tmp_path):
    _live(tmp_path / "out", KittiLayout.PAPER, None, None)
    assert _names(tmp_path / "out") == ["README.md", "frames.csv", "label_2", "velodyne"]


def test_kittis_own_layout_needs_a_camera(tmp_path):
    with pytest.raises(InputError, match="front camera"):
        _live(tmp_path / "out", KittiLayout.KITTI, None, None)


@pytest.mark.parametrize("threads", [1, 2])
def test_threads_write_the_same_files(tmp_path, threads):
    camera = KittiCamera(INTRINSICS, camera_from_lidar(MOUNTS, "lidar", MOUNTS[1].child))
    episode, out = SyntheticEpisode(Scene(duration_s=1.0, lidar=True)), tmp_path / "out"
    out.mkdir()
    pictures = np.random.default_rng(0).integers(0, 256, (10, 60, 80, 3), dtype=np.uint8)
    jpegs = [simplejpeg.encode_jpeg(picture) for picture in pictures]
    with FileWriter(out, threads) as files:
        frames = KittiFrames(files, KittiLayout.KITTI, camera)
        for number, step in enumerate(range(0, 20, 2)):
            frames.write(KittiFrame(step, episode.sweep(step), episode.ground_truth(step), jpegs[number]))
    assert [line.split(",")[0] for line in (out / "frames.csv").read_text().splitlines()[1:]] == [
        f"{number:06d}" for number in range(10)
    ]
    for number, jpeg in enumerate(jpegs):
        with Image.open(out / f"training/image_2/{number:06d}.png") as picture:
            assert np.array_equal(np.asarray(picture), simplejpeg.decode_jpeg(jpeg))


def test_a_picture_that_cannot_be_written_ends_the_export(tmp_path):
    camera = KittiCamera(INTRINSICS, camera_from_lidar(MOUNTS, "lidar", MOUNTS[1].child))
    episode = SyntheticEpisode(Scene(duration_s=1.0, lidar=True))
    jpeg = simplejpeg.encode_jpeg(np.zeros((60, 80, 3), dtype=np.uint8))
    (tmp_path / "training/image_2/000000.png").mkdir(parents=True)

    def export() -> None:
        with FileWriter(tmp_path, 2) as files:
            KittiFrames(files, KittiLayout.KITTI, camera).write(
                KittiFrame(0, episode.sweep(0), episode.ground_truth(0), jpeg)
            )

    with pytest.raises(InputError, match=r"image_2/000000\.png.*[Ii]s a directory"):
        export()
