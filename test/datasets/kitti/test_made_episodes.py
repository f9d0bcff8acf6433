"""KITTI's files of three episodes of formulas, one of which is for test: numbers, places, calibration, tables."""

import csv
import io
from pathlib import Path

import numpy as np
import pytest
from datasets.made_bag import BUS, CAR, FRONT, FRONT_M, LIDAR_M, jpeg_of, sweep_of, truth_of
from PIL import Image

from siren_ros.cli.main import main
from siren_ros.datasets.kitti.paper_labels import label_text

SWEEPS = {0: 19, 1: 10, 2: 10}
"""By seed."""


@pytest.fixture(scope="module")
def dataset(made_bags: list[Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("kitti") / "out"
    assert main(["export", "kitti", *map(str, made_bags), "--out", str(out), "--jobs", "1"]) == 0
    return out


@pytest.fixture(scope="module")
def frames(dataset: Path) -> list[dict[str, str]]:
    return list(csv.DictReader(io.StringIO((dataset / "frames.csv").read_text())))


def seed_of(frame: dict[str, str]) -> int:
    return int(frame["episode"].split("_seed")[1].split("_")[0])


def set_of(dataset: Path, name: str) -> list[str]:
    return (dataset / "ImageSets" / f"{name}.txt").read_text().split()


def folder_of(dataset: Path, number: str) -> Path:
    return dataset / ("testing" if number in set_of(dataset, "test") else "training")


def test_frames_of_all_episodes_are_numbered_in_one_row(frames: list[dict[str, str]]) -> None:
    """The first sweep is at step 4 and each is two steps after the one before."""
    assert [one["frame"] for one in frames] == [f"{number:06d}" for number in range(39)]
    for seed, count in SWEEPS.items():
        own = [one for one in frames if seed_of(one) == seed]
        assert [int(one["step"]) for one in own] == list(range(4, 4 + 2 * count, 2))
        assert [float(one["timestamp"]) for one in own] == pytest.approx(0.05 * np.arange(4, 4 + 2 * count, 2))
        assert [one["episode"] for one in own] == [f"S2_L2_seed{seed}_straight"] * count
    assert [seed_of(one) for one in frames] == sorted(map(seed_of, frames))


def test_one_episode_is_for_test_and_one_for_validation(dataset: Path, frames: list[dict[str, str]]) -> None:
    splits = {name: set_of(dataset, name) for name in ("train", "val", "test", "trainval")}
    assert sorted([*splits["train"], *splits["val"], *splits["test"]]) == [one["frame"] for one in frames]
    assert splits["trainval"] == sorted([*splits["train"], *splits["val"]])
    for name in ("train", "val", "test"):
        seeds = {seed_of(one) for one in frames if one["frame"] in splits[name]}
        assert len(seeds) == 1, "whole episodes"
        assert len(splits[name]) == SWEEPS[seeds.pop()]
    for home, names in (("testing", splits["test"]), ("training", splits["trainval"])):
        for folder, suffix in (("velodyne", "bin"), ("image_2", "png"), ("calib", "txt"), ("label_lidar", "txt")):
            found = sorted(path.name for path in (dataset / home / folder).iterdir())
            assert found == [f"{number}.{suffix}" for number in names]


@pytest.mark.parametrize("row", [0, 7, 18, 19, 28, 38])
def test_a_frames_files_are_those_of_its_step(dataset: Path, frames: list[dict[str, str]], row: int) -> None:
    number, step = frames[row]["frame"], int(frames[row]["step"])
    folder, points = folder_of(dataset, number), sweep_of(step)
    read = np.fromfile(folder / "velodyne" / f"{number}.bin", dtype="<f4").reshape(-1, 4)
    for column, name in enumerate(("x", "y", "z", "intensity")):
        assert read[:, column].tolist() == points[name].tolist()
    with (
        Image.open(folder / "image_2" / f"{number}.png") as picture,
        Image.open(io.BytesIO(jpeg_of(step, FRONT))) as recorded,
    ):
        assert np.asarray(picture)[0, 0].tolist() == pytest.approx(np.asarray(recorded)[0, 0].tolist(), abs=2)
    assert (folder / "label_lidar" / f"{number}.txt").read_text() == label_text(truth_of(step))


def test_the_calibration_is_that_of_the_mounts(dataset: Path) -> None:
    calib = folder_of(dataset, "000000") / "calib" / "000000.txt"
    lines = dict(line.split(": ") for line in calib.read_text().splitlines())
    matrix = np.array(lines["Tr_velo_to_cam"].split(), dtype=float).reshape(3, 4)
    # A point 10 m ahead of the LiDAR, 3 m to its left, at its height.
    ahead_m, up_m = LIDAR_M[0] + 10.0 - FRONT_M[0], LIDAR_M[2] - FRONT_M[2]
    assert matrix @ [10.0, 3.0, 0.0, 1.0] == pytest.approx([-3.0, -up_m, ahead_m])
    assert [float(word) for word in lines["P2"].split()] == [32.0, 0, 32, 0, 0, 32, 24, 0, 0, 0, 1, 0]
    assert len({lines[f"P{index}"] for index in range(4)}) == 1
    assert [float(word) for word in lines["R0_rect"].split()] == np.eye(3).reshape(-1).tolist()


def test_objects_name_the_actors_behind_the_labels(dataset: Path, frames: list[dict[str, str]]) -> None:
    """The car stands in the picture at every frame, the bus behind the camera at none."""
    rows = list(csv.DictReader(io.StringIO((dataset / "objects.csv").read_text())))
    assert [one["frame"] for one in rows] == [one["frame"] for one in frames]
    assert {(one["line"], one["actor_id"], one["type"], one["is_emv"], one["lidar_points"]) for one in rows} == {
        ("0", str(CAR), "Car", "0", "5")
    }
    assert {one["lidar_visibility"] for one in rows} == {"1.000"}
    assert str(BUS) not in {one["actor_id"] for one in rows}
    number = frames[20]["frame"]
    words = (folder_of(dataset, number) / "label_2" / f"{number}.txt").read_text().split()
    assert (words[0], len(words)) == ("Car", 15)
    assert [float(word) for word in words[11:14]] == pytest.approx([-3.0, 1.25 + 0.75 - 0.5, 11.0])


def test_in_the_papers_layout_the_frames_are_numbered_likewise(made_bags: list[Path], tmp_path: Path) -> None:
    out = tmp_path / "out"
    arguments = ["export", "kitti", *map(str, made_bags), "--out", str(out), "--jobs", "1", "--layout", "paper"]
    assert main(arguments) == 0
    names = [f"{number:06d}" for number in range(39)]
    for folder, suffix in (("velodyne", "bin"), ("label_2", "txt"), ("image_2", "jpg"), ("calib", "txt")):
        assert sorted(path.name for path in (out / folder).iterdir()) == [f"{name}.{suffix}" for name in names]
    assert (out / "image_2" / "000019.jpg").read_bytes() == jpeg_of(4, FRONT)
    assert (out / "label_2" / "000001.txt").read_text() == label_text(truth_of(6))
    assert not (out / "ImageSets").exists()
    told = (out / "README.md").read_text()
    assert told.startswith("# The paper's layout, which is not KITTI's")
    assert "# SIREN dataset, format kitti" in told
    assert len((out / "frames.csv").read_text().splitlines()) == 40
