"""Environments of their own for official readers that cannot live in the project's: made once, below .venv.readers/.

A reader runs as a script of ``readers/`` in its environment, reads a dataset and prints what it found as JSON. Where a
package index cannot be reached, or a wheel is not to be had, its tests are skipped and say so.
"""

import fcntl
import hashlib
import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from repository import REPOSITORY

CACHE = REPOSITORY / ".venv.readers"
READERS = Path(__file__).parent / "data" / "datasets" / "readers"
PACKAGES: dict[str, tuple[str, ...]] = {
    # Open3D-ML, which open3d brings, imports these two.
    "open3d_ml": ("--no-deps", "addict", "scikit-learn", "joblib", "threadpoolctl", "narwhals"),
    # The extra dev has nuscenes-devkit, because detections are scored by it.
    "nuscenes": (),
    # av2 asks for torch and more, which its readers of scenarios and maps do not import.
    "av2": ("--no-deps", "av2==0.3.6", "pandas<3", "pytz", "tzdata", "polars", "polars-runtime-32", "rich", "pyproj",
            "certifi", "universal-pathlib", "fsspec", "pathlib-abc", "joblib", "opencv-python-headless<4.12"),
    # ASAM's checker bundles for OpenDRIVE and OpenSCENARIO; their pyclothoids is built here, with a C++ compiler.
    "asam": ("asam-qc-opendrive==1.0.0", "asam-qc-openscenarioxml==1.0.0"),
    "commonroad": ("commonroad-io==2026.1", "lxml"),
    # The checker imports what commonroad-io had up to 2024.3; its polygon3 is built here, with a C compiler.
    "commonroad_drivability": ("commonroad-drivability-checker==2025.4.0", "commonroad-io==2024.3"),
    "scenariogeneration": ("scenariogeneration==0.16.7", "lxml"),
    "metadrive": ("metadrive-simulator==0.4.3",),
    # The extra dev has CARLA's client.
    "carla": (),
    # The reference code of HOTA.
    "trackeval": ("trackeval==1.3.0",),
    # Also writes the recordings: it runs the export.
    "rerun": ("--no-deps", "rerun-sdk>=0.23,<0.24"),
}  # fmt: skip
SEES_THE_PROJECT = {"open3d_ml", "av2", "rerun"}
"""Readers that use the project's own packages where they need them, numpy for one, and install only what is missing."""


def python_of(reader: str) -> Path:
    """The interpreter of a reader's environment; makes the environment where it is missing, or skips the test."""
    if not PACKAGES[reader]:
        return Path(sys.executable)
    key = hashlib.sha256(" ".join((sys.version, *PACKAGES[reader])).encode()).hexdigest()[:12]
    folder = CACHE / f"{reader}-{key}"
    CACHE.mkdir(exist_ok=True)
    with (CACHE / f"{reader}.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not (folder / "complete").exists():
            _make(reader, folder)
    return folder / "bin" / "python"


def _make(reader: str, folder: Path) -> None:
    uv = _uv()
    if uv:
        creation = _run(*uv, "venv", "--clear", "--python", sys.executable, folder)
        install = [*uv, "pip", "install", "--python", folder / "bin" / "python"]
    else:
        creation = _run(sys.executable, "-m", "venv", "--clear", folder)
        install = [folder / "bin" / "python", "-m", "pip", "install", "--retries", "1"]
    assert creation.returncode == 0, creation.stderr
    if reader in SEES_THE_PROJECT:
        site = next(folder.glob("lib/python3*/site-packages"))
        project = next(Path(path) for path in sys.path if path.endswith("site-packages"))
        (site / "project.pth").write_text(f"{project}\n{REPOSITORY}\n")
    done = _run(*install, "-q", *PACKAGES[reader])
    if done.returncode:
        pytest.skip(f"the reader {reader} cannot be installed: {done.stderr.strip().splitlines()[-1]}")
    (folder / "complete").touch()


def _uv() -> list[object]:
    """The project's own uv, which shares files between environments and needs seconds; without one, pip serves."""
    uv = Path(sys.prefix) / "bin" / "uv"
    return [sys.executable, REPOSITORY / "tools" / "environment" / "uv_like_pip.py"] if uv.exists() else []


def _run(*command: object) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        list(map(str, command)), capture_output=True, text=True, check=False, env=_plain_environment()
    )


def _plain_environment() -> dict[str, str]:
    """Variables of this process; readers keep their bytecode, which installers do not make."""
    others = {"PYTHONPATH", "LD_LIBRARY_PATH", "PYTHONDONTWRITEBYTECODE"}
    return {key: value for key, value in os.environ.items() if key not in others}


def read_with(reader: str, script: str, *arguments: object, timeout_s: float = 240.0) -> Any:
    """What a script of ``readers/`` prints about a dataset, read as JSON from its last line."""
    command = [python_of(reader), READERS / script, *map(str, arguments)]
    environment = {**_plain_environment(), "MPLBACKEND": "Agg"}
    done = subprocess.run(
        command, capture_output=True, text=True, check=False, timeout=timeout_s, env=environment, cwd="/"
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.strip().splitlines()[-1])
