"""OpenPCDet's custom dataset: its documented layout, and the geometry of the episode."""

from pathlib import Path

import numpy as np
import pytest

from siren_ros.cli.main import main
from siren_ros.datasets.openpcdet import NAME_OF_CLASS
from siren_ros.datasets.sources.episode_source import open_source
from siren_ros.datasets.sources.lidar_frames import lidar_frames
from siren_ros.world.actors import ActorClass


@pytest.fixture(scope="module")
def dataset(sensed_bag: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("openpcdet") / "out"
    assert main(["export", "openpcdet", str(sensed_bag), "--out", str(out)]) == 0
    return out


def test_the_layout_is_the_tutorials(dataset: Path) -> None:
    numbers = [f"{number:06d}" for number in range(20)]
    assert [path.stem for path in sorted((dataset / "points").iterdir())] == numbers
    assert [path.stem for path in sorted((dataset / "labels").iterdir())] == numbers
    assert (dataset / "ImageSets" / "train.txt").read_text().split() == numbers
    assert (dataset / "ImageSets" / "val.txt").read_text() == ""


def test_boxes_hold_the_points_that_hit_their_vehicle(dataset: Path, sensed_bag: Path) -> None:
    with open_source(sensed_bag) as source:
        frames = [
            (one.points.copy(), one.truth) for one in lidar_frames(source) if one.points is not None and one.truth
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
            own = points["instance"] == truth.actor_id[row]
            assert inside[own].all()
            assert set(points["instance"][inside].tolist()) <= {0, int(truth.actor_id[row])}
            assert np.cos(heading - truth.yaw_rad[row]) == pytest.approx(1.0, abs=1e-7)
            assert words[7] == NAME_OF_CLASS[ActorClass(int(truth.actor_class[row]))]


def test_every_class_has_a_name() -> None:
    assert set(NAME_OF_CLASS) == set(ActorClass)
