"""The program that trains a driver, with a tiny budget: Stable-Baselines3 runs as it is."""

import subprocess
import sys
from pathlib import Path

import pytest
from repository import REPOSITORY

pytest.importorskip("stable_baselines3", reason="the extra rl is not installed")


def test_it_trains_and_drives_a_seed_that_the_training_does_not_draw(tmp_path: Path) -> None:
    program = [sys.executable, str(REPOSITORY / "examples" / "train_driver.py")]
    options = ["--steps", "16", "--rollout", "8", "--out", str(tmp_path / "driver.zip")]
    ended = subprocess.run([*program, *options], capture_output=True, text=True, check=False)
    assert ended.returncode == 0, ended.stderr
    assert (tmp_path / "driver.zip").stat().st_size > 0
    assert "seed 1000: reward" in ended.stdout
    assert "'contact'" in ended.stdout
