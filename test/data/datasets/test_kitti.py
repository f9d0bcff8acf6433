"""KITTI's files: labels of one car written out, frames, and three episodes of formulas, one of which is for test."""

import csv
import io
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import simplejpeg
from datasets.made_bag import CAR, FRONT, FRONT_M, LIDAR_M, jpeg_of, sweep_of, truth_of
from PIL import Image
from reader_environments import read_with
from synthetic_episode import Scene, SyntheticEpisode

from siren_ros.base.numerics.geometry import wrap_angle
from siren_ros.data.datasets.files import FileWriter
from siren_ros.data.datasets.kitti import (
    TYPE_OF_CLASS,
    CameraLabels,
    KittiCamera,
    KittiFrame,
    KittiFrames,
    camera_from_lidar,
    camera_labels,
    label_lines,
    label_text,
    png_bytes,
    png_of_jpeg,
    velodyne_bytes,
)
from siren_ros.data.episode_source import lidar_frames, open_source
from siren_ros.data.interfaces.measurements import Transform
from siren_ros.errors import InputError
from siren_ros.simulation.scenario.episode import KittiLayout
from siren_ros.simulation.world.actors import ActorClass
from siren_ros.simulation.world.carrier import CameraIntrinsics, GroundTruth

CAMERA = KittiCamera(
    CameraIntrinsics(800, 600, 400.0, 400.0, 400.0, 300.0),
    np.array([[0.0, -1.0, 0, 0], [0, 0, -1.0, -0.5], [1.0, 0, 0, -1.5], [0, 0, 0, 1.0]]),
)
"""1.5 m ahead of the LiDAR and 0.5 m below it; right, down, ahead."""
POINT = np.dtype([("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("instance", "<u2")])


def a_van(x_m: float, y_m: float, yaw_rad: float, lidar_points: int = 10) -> GroundTruth:
    """A van whose centre is 1 m below the LiDAR."""
    car = {name: column[:1] for name, column in vars(truth_of(3)).items() if isinstance(column, np.ndarray)}
    place = {"x_m": x_m, "y_m": y_m, "z_m": -1.0, "yaw_rad": yaw_rad}
    changed = {name: np.array([value]) for name, value in place.items()}
    kind = np.array([ActorClass.VAN], dtype=np.uint8)
    returns = np.array([lidar_points], dtype=np.uint32)
    return replace(truth_of(3), **{**car, **changed, "actor_class": kind, "lidar_points": returns})


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
    assert labels.size_m.tolist() == [[1.5, 1.8, 4.0]]
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


@pytest.fixture(scope="module")
def frames(made_dataset: Path) -> list[dict[str, str]]:
    return list(csv.DictReader(io.StringIO((made_dataset / "frames.csv").read_text())))


def set_of(made_dataset: Path, name: str) -> list[str]:
    return (made_dataset / "ImageSets" / f"{name}.txt").read_text().split()


def folder_of(made_dataset: Path, number: str) -> Path:
    return made_dataset / ("testing" if number in set_of(made_dataset, "test") else "training")


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


def test_frames_of_all_episodes_are_numbered_in_one_row_and_each_episode_is_in_one_split(made_dataset, frames):
    """The first sweep is at step 4 and each is two steps after the one before."""
    steps = {seed: list(range(4, 4 + 2 * count, 2)) for seed, count in SWEEPS.items()}
    assert [frame["frame"] for frame in frames] == [f"{number:06d}" for number in range(39)]
    assert [int(frame["step"]) for frame in frames] == [*steps[0], *steps[1], *steps[2]]
    assert [float(frame["timestamp"]) for frame in frames] == pytest.approx(
        [0.05 * int(frame["step"]) for frame in frames]
    )
    assert [frame["episode"] for frame in frames] == [
        f"S2_L2_seed{seed}_straight" for seed, own in steps.items() for _ in own
    ]
    splits = {name: set_of(made_dataset, name) for name in ("train", "val", "test", "trainval")}
    numbers = [frame["frame"] for frame in frames]
    assert [splits[name] for name in ("train", "val", "test")] == [numbers[:19], numbers[19:29], numbers[29:]]
    assert splits["trainval"] == numbers[:29]
    for home, names in (("testing", splits["test"]), ("training", splits["trainval"])):
        for folder, suffix in (("velodyne", "bin"), ("image_2", "png"), ("calib", "txt"), ("label_lidar", "txt")):
            files = sorted(path.name for path in (made_dataset / home / folder).iterdir())
            assert files == [f"{number}.{suffix}" for number in names]
    counts = json.loads((made_dataset / "dataset.json").read_text())["counts"]
    assert counts == {"frames": 39, "labels": 39}


def test_the_calibration_is_that_of_the_mounts(made_dataset):
    calib = folder_of(made_dataset, "000000") / "calib" / "000000.txt"
    lines = dict(line.split(": ") for line in calib.read_text().splitlines())
    assert list(lines) == ["P0", "P1", "P2", "P3", "R0_rect", "Tr_velo_to_cam", "Tr_imu_to_velo"]
    matrix = np.array(lines["Tr_velo_to_cam"].split(), dtype=float).reshape(3, 4)
    # A point 10 m ahead of the LiDAR, 3 m to its left, at its height.
    ahead_m, up_m = LIDAR_M[0] + 10.0 - FRONT_M[0], LIDAR_M[2] - FRONT_M[2]
    assert matrix @ [10.0, 3.0, 0.0, 1.0] == pytest.approx([-3.0, -up_m, ahead_m])
    assert [float(word) for word in lines["P2"].split()] == [32.0, 0, 32, 0, 0, 32, 24, 0, 0, 0, 1, 0]
    assert len({lines[f"P{index}"] for index in range(4)}) == 1
    assert [float(word) for word in lines["R0_rect"].split()] == np.eye(3).reshape(-1).tolist()
    assert [float(word) for word in lines["Tr_imu_to_velo"].split()] == np.eye(4)[:3].reshape(-1).tolist()


def test_objects_name_the_actors_behind_the_labels(made_dataset, frames):
    """The car stands in the picture at every frame, the bus behind the camera at none."""
    rows = list(csv.DictReader(io.StringIO((made_dataset / "objects.csv").read_text())))
    assert [row.pop("frame") for row in rows] == [frame["frame"] for frame in frames]
    car = {"line": "0", "actor_id": str(CAR), "type": "Car", "is_emv": "0", "lidar_points": "5"}
    assert all(row == car | {"lidar_visibility": "1.000"} for row in rows)
    number = frames[20]["frame"]
    words = (folder_of(made_dataset, number) / "label_2" / f"{number}.txt").read_text().split()
    assert (words[0], len(words)) == ("Car", 15)
    numbers = [float(word) for word in words[8:]]
    turned = float(wrap_angle(-0.5 - np.pi / 2.0))
    assert numbers == pytest.approx([1.5, 1.8, 4.0, -3.0, 1.25 + 0.75 - 0.5, 11.0, turned], abs=1e-4)


def test_a_reader_of_others_finds_the_vehicles(dataset, sensed_bag):
    """Open3D-ML, at the first, the middle and the last frame."""
    read = read_with("open3d_ml", "read_kitti.py", dataset / "training", "000000", "000010", "000019")
    objects = list(csv.DictReader(io.StringIO((dataset / "objects.csv").read_text())))
    with open_source(sensed_bag) as source:
        truths = {frame.step // 2: (frame.truth, len(frame.points)) for frame in lidar_frames(source) if frame.truth}
    for name, in_frame in read.items():
        truth, points = truths[int(name)]
        assert in_frame["points"] > 0.2 * points, "Open3D-ML may keep what the camera sees"
        rows = [truth.actor_id.tolist().index(int(entry["actor_id"])) for entry in objects if entry["frame"] == name]
        assert len(in_frame["boxes"]) == len(rows) > 2
        for box, row in zip(in_frame["boxes"], rows, strict=True):
            assert box["centre"] == pytest.approx((truth.x_m[row], truth.y_m[row], truth.z_m[row]), abs=2e-4)
            size = (truth.width_m[row], truth.height_m[row], truth.length_m[row])
            assert box["size_whl"] == pytest.approx(size, abs=1e-4)


def test_another_reader_sees_the_same_pixels():
    random = np.random.default_rng(0)
    for shape in ((1, 1, 3), (5, 7, 3), (60, 80, 3)):
        rgb = random.integers(0, 256, shape, dtype=np.uint8)
        with Image.open(io.BytesIO(png_bytes(rgb))) as picture:
            assert np.array_equal(np.asarray(picture), rgb)
    jpeg = simplejpeg.encode_jpeg(rgb, quality=95)
    with Image.open(io.BytesIO(png_of_jpeg(jpeg))) as picture:
        assert np.array_equal(np.asarray(picture), simplejpeg.decode_jpeg(jpeg))


def test_a_label_of_the_paper_is_the_box_in_the_lidar_frame():
    """At 3 s the EMV is at x = 52, the first civilian at x = 58 and on its way to the left."""
    truth = SyntheticEpisode().ground_truth(60)
    kind, *words = label_text(truth).splitlines()[0].split()
    alpha, *box, height, width, length, x, y, z, heading = (float(word) for word in words[2:])
    assert (kind, words[:2], box) == ("Car", ["0.00", "0"], [0.0] * 4), "no box in a picture"
    assert (height, width, length) == pytest.approx((1.45, 1.8, 4.6))
    assert (x, y, z) == pytest.approx((6.0, truth.y_m[0], 1.45 / 2 - 1.93), abs=1e-4)
    assert heading == pytest.approx(truth.yaw_rad[0], abs=1e-4)
    assert min(y, heading) > 0.0
    assert alpha == pytest.approx(heading - np.arctan2(y, x), abs=1e-3)


def test_objects_beyond_50_m_are_dropped():
    truth = SyntheticEpisode().ground_truth(0)
    assert truth.x_m.tolist() == [30.0, 45.0, 60.0, 75.0]
    assert len(label_text(truth).splitlines()) == 2
    moved = replace(truth, x_m=np.full(4, 30.0), y_m=np.array([40.0, -40.0, 40.1, -40.1]))
    assert len(label_text(moved).splitlines()) == 2


def test_what_lacks_a_frame_a_field_or_a_camera_is_refused(tmp_path):
    mounts = [Transform(parent, child, (0.0,) * 3, (0.0, 0.0, 0.0, 1.0)) for parent, child in ("ab", "ac", "xd")]
    for names, named in ((("b", "nothing"), "nothing"), (("nothing", "b"), "nothing"), (("b", "d"), "parent")):
        with pytest.raises(InputError, match=named):
            camera_from_lidar(tuple(mounts), *names)
    with pytest.raises(InputError, match="intensity"):
        velodyne_bytes(np.zeros(2, dtype=[("x", "f4"), ("y", "f4"), ("z", "f4")]))
    with FileWriter(tmp_path) as files, pytest.raises(InputError, match="front camera"):
        KittiFrames(files, KittiLayout.KITTI, None)


def test_the_papers_layout_needs_no_camera(tmp_path):
    episode = SyntheticEpisode(Scene(duration_s=1.0, lidar=True))
    with FileWriter(tmp_path) as files:
        frames = KittiFrames(files, KittiLayout.PAPER, None)
        frames.write(KittiFrame(2, episode.sweep(2), episode.ground_truth(2), None))
    assert frames.frames == 1
    assert sorted(path.name for path in tmp_path.iterdir()) == ["README.md", "frames.csv", "label_2", "velodyne"]
