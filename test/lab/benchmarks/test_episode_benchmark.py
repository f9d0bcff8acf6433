import json

import pytest
from dds_domains import own_domain

from siren_ros.errors import EXIT_OK
from siren_ros.lab.benchmarks.episode import main, shares_of
from siren_ros.running.ros.programs.progress import time_table


def test_shares_are_those_of_the_summary():
    busy_s = {"sumo_bridge": 1.0, "emv_controller": 0.5, "yield_manager": 1.5, "sensor_sim": 4.0, "somebody": 2.0}
    shares = shares_of("\n".join(["real-time factor 2.00 (20.0 s of wall time)", *time_table(busy_s, 20.0)]))
    expected = {"sumo": 0.05, "drivers": 0.1, "dynamics": 0.0, "sensors": 0.2, "recorder": 0.0, "transport": 0.55}
    assert shares == pytest.approx(expected)


def test_an_episode_is_measured_from_outside(tmp_path, capsys, monkeypatch):
    monkeypatch.setenv("ROS_DOMAIN_ID", str(own_domain()))
    file = tmp_path / "episode.json"
    assert main(["duration_s:=0.5", "--suites", "none", "--json", str(file)]) == EXIT_OK
    row = json.loads(file.read_text())["none"]
    assert row["real_time_factor"] > 0.0
    assert row["bag_mb"] > 0.1
    assert row["memory_mb"] > 50.0
    assert "none" in capsys.readouterr().out
