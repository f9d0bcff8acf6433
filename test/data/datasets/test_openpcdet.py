"""OpenPCDet's custom dataset: its documented layout, and the geometry of the episode."""

import json
from dataclasses import replace

import numpy as np
import pytest
from datasets.made_bag import sweep_of, truth_of

from siren_ros.data.datasets.kitti import NAME_OF_CLASS, openpcdet_lines
from siren_ros.data.episode_source import lidar_frames, open_source
from siren_ros.simulation.world.actors import ActorClass

DATASET = ("openpcdet", "sensed_bag")
MADE_DATASET = ("openpcdet", "made_bags")


def test_boxes_hold_the_points_that_hit_their_vehicle(dataset, sensed_bag):
    with open_source(sensed_bag) as source:
        frames = [
            (frame.points.copy(), frame.truth)
            for frame in lidar_frames(source)
            if frame.points is not None and frame.truth
        ]
    assert len(frames) == 20
    for number in (0, 9, 19):
        points, truth = frames[number]
        read = np.load(dataset / "points" / f"{number:06d}.npy")
        assert read.shape == (len(points), 4)
        assert read.dtype == np.float32
        labels = [line.split() for line in (dataset / "labels" / f"{number:06d}.txt").read_text().splitlines()]
        seen = np.flatnonzero(truth.lidar_points > 0)
        assert len(labels) == len(seen) > 3
        for words, row in zip(labels, seen.tolist(), strict=True):
            x, y, z, dx, dy, dz, heading = map(float, words[:7])
            offset = read[:, :3].astype(float) - [x, y, z]
            along = offset[:, 0] * np.cos(heading) + offset[:, 1] * np.sin(heading)
            across = offset[:, 1] * np.cos(heading) - offset[:, 0] * np.sin(heading)
            inside = (abs(along) < dx / 2 + 0.01) & (abs(across) < dy / 2 + 0.01) & (abs(offset[:, 2]) < dz / 2 + 0.01)
            returns = points["instance"] == truth.actor_id[row]
            assert inside[returns].all()
            assert set(points["instance"][inside].tolist()) <= {0, int(truth.actor_id[row])}
            assert np.cos(heading - truth.yaw_rad[row]) == pytest.approx(1.0, abs=1e-7)
            assert words[7] == NAME_OF_CLASS[ActorClass(int(truth.actor_class[row]))]


def test_frames_of_all_episodes_are_numbered_in_one_row(made_dataset):
    head, *rows = (line.split(",") for line in (made_dataset / "frames.csv").read_text().splitlines())
    assert head == ["frame", "episode", "step", "timestamp"]
    assert [row[0] for row in rows] == [f"{number:06d}" for number in range(39)]
    steps = [int(row[2]) for row in rows]
    assert steps == [*range(4, 42, 2), *range(4, 24, 2), *range(4, 24, 2)]
    assert [float(row[3]) for row in rows] == pytest.approx([0.05 * step for step in steps])
    assert [row[1] for row in rows] == [f"S2_L2_seed{seed}_straight" for seed in [0] * 19 + [1] * 10 + [2] * 10]
    sets = [(made_dataset / "ImageSets" / f"{name}.txt").read_text().split() for name in ("train", "val", "test")]
    assert sorted(number for numbers in sets for number in numbers) == [row[0] for row in rows]
    assert sorted(map(len, sets)) == [10, 10, 19]
    for number in (0, 18, 19, 38):
        read = np.load(made_dataset / "points" / f"{number:06d}.npy")
        points = sweep_of(steps[number])
        assert read.dtype == np.float32
        expected = np.stack([points[name] for name in ("x", "y", "z", "intensity")], axis=1)
        assert np.array_equal(read, expected)
    assert json.loads((made_dataset / "dataset.json").read_text())["counts"] == {"frames": 39, "labels": 39}


def test_a_label_is_centre_size_heading_and_name(made_dataset):
    """The bus has no return and is left out."""
    text = (made_dataset / "labels" / "000007.txt").read_text()
    assert text == "12.0000 3.0000 -1.2500 4.0000 1.8000 1.5000 0.5000 Car\n"


def test_who_has_fewer_returns_than_asked_for_is_left_out():
    truth = truth_of(0)
    assert [len(openpcdet_lines(truth, least)) for least in (0, 1, 5, 6)] == [2, 1, 1, 0]
    assert set(NAME_OF_CLASS) == set(ActorClass)
    bus = openpcdet_lines(truth, 0)[1].split()
    assert bus == ["-15.0000", "-4.0000", "-0.5000", "12.0000", "2.5000", "3.0000", "-2.0000", "Bus"]


def test_headings_lie_within_half_a_turn_and_zero_has_no_sign():
    turned = replace(truth_of(0), yaw_rad=np.array([3.5, -3.5]), y_m=np.array([-1e-9, 0.0]))
    lines = [line.split() for line in openpcdet_lines(turned, 0)]
    assert [float(line[6]) for line in lines] == pytest.approx([3.5 - 2.0 * np.pi, 2.0 * np.pi - 3.5], abs=1e-4)
    assert [line[1] for line in lines] == ["0.0000", "0.0000"]
