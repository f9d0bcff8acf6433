"""NGSIM's two layouts of a drive of formulas, in the published loaders' columns."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from datasets.made_bag import BUS, CAR, EMV
from scipy.io import loadmat

from siren_ros.cli.main import main
from siren_ros.datasets.ngsim.conventions import FOOT_M

WINDOWS = {EMV: 131 - 80, CAR: 126 - 80, BUS: 129 - 80}
"""Whole windows of 81 frames of each vehicle."""


@pytest.fixture(scope="module")
def dataset(made_drive: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("ngsim") / "out"
    assert main(["export", "ngsim", str(made_drive), "--out", str(out), "--population", "all"]) == 0
    return out


def read(dataset: Path, layout: str, name: str) -> tuple[Any, Any]:
    content = loadmat(dataset / layout / name)
    return content["traj"], content["tracks"]


def test_a_row_for_each_window_and_a_data_set_for_each_row(dataset: Path) -> None:
    data, tracks = read(dataset, "stdan", "TrainSet.mat")
    assert data.shape == (sum(WINDOWS.values()), 50)
    assert data[:, 0].tolist() == list(range(1, len(data) + 1))
    assert len(tracks) == len(data)
    assert set(data[:, 1].tolist()) == {1.0}
    for name in ("ValSet.mat", "TestSet.mat"):
        assert read(dataset, "stdan", name)[0].shape == (0, 50)
        assert read(dataset, "csp", name)[0].shape == (0, 47)
    card = json.loads((dataset / "dataset.json").read_text())
    assert card["counts"] == {"samples": len(data)}
    assert card["classes"]["keep"] == len(data)


def test_columns_of_both_layouts(dataset: Path) -> None:
    """The EMV's third window: its present is frame 32, the bus is 20 m − 3.2 m ahead in the lane to the left."""
    data, tracks = read(dataset, "stdan", "TrainSet.mat")
    row = data[2]
    assert row[2] == 32.0
    assert row[3:7] == pytest.approx([0.0, 0.0, 10.0 / FOOT_M, 0.0])
    assert row[7:11].tolist() == [2.0, 2.0, 1.0, 1.0], "right lane, a car, keeps lane and speed"
    ahead_ft = {BUS: (20.0 - 3.2) / FOOT_M, CAR: (60.0 + 6.0 * 2.7 + 0.1 * 2.7**2 - 52.0) / FOOT_M}
    cells = {int(cell): int(row[11 + cell]) for cell in np.flatnonzero(row[11:]).tolist()}
    column = {BUS: 0, CAR: 1}
    near = {key for key, value in ahead_ft.items() if value < 90.0 and key != CAR}
    assert cells == {13 * column[key] + round((ahead_ft[key] + 90.0) / 15.0): 2 for key in near}
    bus = tracks[2][1]
    assert bus[0].tolist() == list(range(2, 83))
    assert bus[1] == pytest.approx(np.full(81, -3.5 / FOOT_M)), "to the left is negative"
    assert bus[2] == pytest.approx((20.0 + 0.9 * bus[0] - 1.0 * 32.0) / FOOT_M)
    assert set(bus[6].tolist()) == {3.0}
    short, short_tracks = read(dataset, "csp", "TrainSet.mat")
    assert np.array_equal(short, np.delete(data, [5, 6, 8], axis=1))
    assert np.array_equal(short_tracks[2][1], bus[:3])


def test_who_gains_speed_is_no_class_of_the_shorter_layout(dataset: Path) -> None:
    """The car's mean speed of the next 5 s is at most 1.12 times that of the last 3 s."""
    data, _ = read(dataset, "stdan", "TrainSet.mat")
    own = slice(WINDOWS[EMV], WINDOWS[EMV] + WINDOWS[CAR])
    assert data[own, 2].tolist() == list(range(35, 35 + WINDOWS[CAR]))
    assert data[own, 6] == pytest.approx(np.full(WINDOWS[CAR], 0.2 / FOOT_M))
    assert set(data[own, 10].tolist()) == {1.0}
