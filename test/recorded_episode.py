"""Records an episode as a user does."""

import fcntl
import os
import subprocess
import sys
from pathlib import Path

import pytest
from dds_domains import shared_domain
from repository import REPOSITORY


def record(folder: Path, *parameters: str) -> Path:
    """The bag of an episode with some parameters of ``cosim``."""
    bag = folder / "bag"
    environment = {
        "FASTRTPS_DEFAULT_PROFILES_FILE": str(REPOSITORY / "params" / "fastdds_localhost.xml"),
        **os.environ,
        "ROS_DOMAIN_ID": str(shared_domain()),
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
    }
    # The first program of a checkout compiles its loops in its first steps.
    patient = ("step_timeout_s:=600.0", "start_timeout_s:=600.0")
    words = [word for value in (*parameters, *patient, f"bag:={bag}", "kitti:=false") for word in ("-p", value)]
    command = [sys.executable, "-m", "siren_nodes.cosim", "--ros-args", *words]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=900, check=False)
    assert done.returncode == 0, done.stderr
    return bag


def shared_recording(tmp_path_factory: pytest.TempPathFactory, name: str, *parameters: str) -> Path:
    """The bag of an episode that all workers of a test run read, recorded by the first of them that wants it."""
    base = tmp_path_factory.getbasetemp()
    folder = (base.parent if "PYTEST_XDIST_WORKER" in os.environ else base) / "recorded" / name
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / "lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not (folder / "bag").exists():
            record(folder, *parameters)
    return folder / "bag"


def sensed_recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two seconds with LiDAR and four cameras, watched by the detector that ships: 20 sweeps, 4 keyframes."""
    parameters = ("template:=S2", "sensors:=full", "duration_s:=2.0", "detector:=pillars")
    return shared_recording(tmp_path_factory, "full", *parameters)


def tracked_recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Fourteen seconds without sensors: long enough for windows of prediction."""
    return shared_recording(tmp_path_factory, "tracked", "template:=S3", "sensors:=none", "duration_s:=14.0")
