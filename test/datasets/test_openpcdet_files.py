"""OpenPCDet's files of three episodes of formulas: numbering, boxes, who is left out."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from datasets.made_bag import sweep_of, truth_of

from siren_ros.cli.main import main
from siren_ros.datasets.openpcdet import label_lines


@pytest.fixture(scope="module")
def dataset(made_bags: list[Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("openpcdet") / "out"
    assert main(["export", "openpcdet", *map(str, made_bags), "--out", str(out), "--jobs", "1"]) == 0
    return out


def test_frames_of_all_episodes_are_numbered_in_one_row(dataset: Path) -> None:
    head, *rows = (line.split(",") for line in (dataset / "frames.csv").read_text().splitlines())
    assert head == ["frame", "episode", "step", "timestamp"]
    assert [row[0] for row in rows] == [f"{number:06d}" for number in range(39)]
    steps = [int(row[2]) for row in rows]
    assert steps == [*range(4, 42, 2), *range(4, 24, 2), *range(4, 24, 2)]
    assert [float(row[3]) for row in rows] == pytest.approx([0.05 * step for step in steps])
    assert [row[1] for row in rows] == [f"S2_L2_seed{seed}_straight" for seed in [0] * 19 + [1] * 10 + [2] * 10]
    sets = [(dataset / "ImageSets" / f"{name}.txt").read_text().split() for name in ("train", "val", "test")]
    assert sorted(number for numbers in sets for number in numbers) == [row[0] for row in rows]
    assert sorted(map(len, sets)) == [10, 10, 19]
    for number in (0, 18, 19, 38):
        read = np.load(dataset / "points" / f"{number:06d}.npy")
        points = sweep_of(steps[number])
        assert read.dtype == np.float32
        expected = np.stack([points[name] for name in ("x", "y", "z", "intensity")], axis=1)
        assert np.array_equal(read, expected)
    assert json.loads((dataset / "dataset.json").read_text())["counts"] == {"frames": 39, "labels": 39}


def test_a_label_is_centre_size_heading_and_name(dataset: Path) -> None:
    """The bus has no return and is left out."""
    text = (dataset / "labels" / "000007.txt").read_text()
    assert text == "12.0000 3.0000 -1.2500 4.0000 1.8000 1.5000 0.5000 Car\n"


def test_who_has_fewer_returns_than_asked_for_is_left_out() -> None:
    truth = truth_of(0)
    assert [len(label_lines(truth, least)) for least in (0, 1, 5, 6)] == [2, 1, 1, 0]
    bus = label_lines(truth, 0)[1].split()
    assert bus == ["-15.0000", "-4.0000", "-0.5000", "12.0000", "2.5000", "3.0000", "-2.0000", "Bus"]


def test_headings_lie_within_half_a_turn_and_zero_has_no_sign() -> None:
    turned = replace(truth_of(0), yaw_rad=np.array([3.5, -3.5]), y_m=np.array([-1e-9, 0.0]))
    lines = [line.split() for line in label_lines(turned, 0)]
    assert [float(line[6]) for line in lines] == pytest.approx([3.5 - 2.0 * np.pi, 2.0 * np.pi - 3.5], abs=1e-4)
    assert [line[1] for line in lines] == ["0.0000", "0.0000"]
