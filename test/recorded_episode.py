"""Records an episode as a user does."""

import atexit
import fcntl
import os
import re
import subprocess
import sys
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from dds_domains import shared_domain
from repository import REPOSITORY

_FOLDER = TemporaryDirectory(prefix="siren_templates_")  # while the tests run
atexit.register(_FOLDER.cleanup)


@cache
def quick_template(name: str) -> str:
    """A file of a template, of its name, whose episodes have little traffic and 1 s of warm-up.

    The warm-up with the district's traffic is most of the cost of an episode of a second.
    """
    text = (REPOSITORY / "params" / "templates" / f"{name}.yaml").read_text(encoding="utf-8")
    for value, quick in ((r"^warm_up_s: [\d.]+", "warm_up_s: 1.0"), (r"(lane_km: {default:) [\d.]+", r"\1 0.0")):
        text, changed = re.subn(value, quick, text, count=1, flags=re.MULTILINE)
        assert changed, value
    file = Path(_FOLDER.name) / f"{name}.yaml"
    file.write_text(text, encoding="utf-8")
    return str(file)


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
