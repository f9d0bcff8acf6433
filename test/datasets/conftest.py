"""Bags of real episodes that the tests of the formats share."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from dds_domains import own_domain
from repository import REPOSITORY
from synthetic_episode import NET_XML

from siren_ros.roads.net_parser import parse_road_network
from siren_ros.roads.road_network import RoadNetwork


@pytest.fixture(scope="session")
def straight_road_of_two_lanes() -> RoadNetwork:
    """Two lanes eastwards and two westwards."""
    return parse_road_network(NET_XML.encode())


def _episode(folder: Path, *parameters: str) -> Path:
    bag = folder / "bag"
    environment = {
        "FASTRTPS_DEFAULT_PROFILES_FILE": str(REPOSITORY / "params" / "fastdds_localhost.xml"),
        **os.environ,
        "ROS_DOMAIN_ID": str(own_domain()),
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
    }
    words = [word for value in (*parameters, f"bag:={bag}", "kitti:=false") for word in ("-p", value)]
    command = [sys.executable, "-m", "siren_nodes.cosim", "--ros-args", *words]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stderr
    return bag


@pytest.fixture(scope="session")
def sensed_bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three seconds with LiDAR and four cameras."""
    return _episode(tmp_path_factory.mktemp("sensed"), "template:=S2", "sensors:=full", "duration_s:=3.0")


@pytest.fixture(scope="session")
def tracked_bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Fourteen seconds without sensors, at a junction with signals."""
    return _episode(tmp_path_factory.mktemp("tracked"), "template:=S3", "sensors:=none", "duration_s:=14.0")
