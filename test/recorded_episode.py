"""Records an episode as a user does."""

import os
import subprocess
import sys
from pathlib import Path

from dds_domains import own_domain
from repository import REPOSITORY


def record(folder: Path, *parameters: str) -> Path:
    """The bag of an episode with some parameters of ``cosim``."""
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
