"""An episode of a second, and a server whose map is the episode's."""

from pathlib import Path

import pytest
from carla_server import SIZES, carla_server, signals_in
from recorded_episode import quick_template

from siren_ros.data.datasets.simulator_scenarios import opendrive_of
from siren_ros.data.episode_source import EpisodeSource
from siren_ros.data.recording.bag_reader import open_bag
from siren_ros.running.generation.closed_loop import record_episode
from siren_ros.running.generation.episode_setup import set_up_episode
from siren_ros.simulation.scenario.episode import EpisodeRequest

SUITE = """
lidars:
  lidar: {mount: {x_m: 0.5, y_m: 0.0, z_m: 1.93, yaw_deg: 10.0}, channels: 8, points_per_second: 40000, rate_hz: 20}
cameras:
  camera_front: {mount: {x_m: 2.5, y_m: 0.0, z_m: 1.0}, width: 64, height: 48, depth: true, semantic: true}
imus:
  imu: {mount: {x_m: 0.0, y_m: 0.0, z_m: 0.5}}
"""
STEPS = 20


@pytest.fixture(scope="session")
def bag(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("carla")
    suite = folder / "small.yaml"
    suite.write_text(SUITE)
    asked = EpisodeRequest(template=quick_template("S2"), duration_s=STEPS * 0.05, sensors=str(suite))
    record_episode(set_up_episode(asked), folder / "bag")
    return folder / "bag"


@pytest.fixture(scope="session")
def drive(bag) -> str:
    with open_bag(bag) as opened:
        return opendrive_of(EpisodeSource(opened)).decode()


@pytest.fixture
def server(drive):
    with carla_server(drive, SIZES, signals_in(drive)) as running:
        yield running
