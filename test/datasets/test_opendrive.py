"""OpenDRIVE as CARLA reads it."""

import json
from pathlib import Path

import numpy as np
import pytest
from reader_environments import read_with

from siren_ros.cli.main import main
from siren_ros.datasets.sources.episode_source import open_source
from siren_ros.roads.road_network import LaneKind


@pytest.fixture(scope="module")
def dataset(tracked_bag: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("opendrive") / "out"
    assert main(["export", "opendrive", str(tracked_bag), "--out", str(out)]) == 0
    return out


def test_carla_finds_the_lanes_where_they_are(dataset: Path, tracked_bag: Path) -> None:
    with open_source(tracked_bag) as source:
        lanes = [lane for lane in source.network.lanes if lane.kind is LaneKind.DRIVING and lane.length_m > 20.0]
    middles = np.array([lane.centre.at(np.array([lane.length_m / 2.0]))[0] for lane in lanes])
    (file,) = dataset.glob("*.xodr")
    read = read_with("carla", "read_opendrive.py", file, json.dumps(middles.tolist()))
    found = np.array([place[:2] for place in read["places"]])
    assert len(lanes) > 30
    off = [abs(lane.centre.project(found[row : row + 1])[1][0]) for row, lane in enumerate(lanes)]
    assert np.median(off) < 0.001
    assert max(off) < 0.2, "the corners of bends are cut differently"
    turned = [
        np.cos(np.radians(place[2]) - lane.centre.heading_rad(lane.length_m / 2.0))
        for place, lane in zip(read["places"], lanes, strict=True)
    ]
    assert min(turned) > 0.9, "lanes run in their direction"
    assert read["topology"] > len(lanes)


def test_the_same_map_gives_the_same_file(dataset: Path, tracked_bag: Path, tmp_path: Path) -> None:
    assert main(["export", "opendrive", str(tracked_bag), "--out", str(tmp_path / "out")]) == 0
    (one,), (two,) = dataset.glob("*.xodr"), (tmp_path / "out").glob("*.xodr")
    assert (one.name, one.read_bytes()) == (two.name, two.read_bytes())
    assert b"netconvertConfiguration" not in one.read_bytes()
