"""The examples that join an episode over ROS, without one."""

import signal
import subprocess
import sys

import pytest
from repository import REPOSITORY

pytest.importorskip("rclpy", reason="ROS 2 is not there")
SIGNALLED = """import os, runpy, sys, threading, rclpy
path, number = sys.argv[1:]
del sys.argv[1:]
spin_once = rclpy.spin_once
def interrupted(node, timeout_sec):
    rclpy.spin_once = spin_once
    threading.Timer(0.2, os.kill, (os.getpid(), int(number))).start()
    spin_once(node, timeout_sec=timeout_sec)
rclpy.spin_once = interrupted
runpy.run_path(path, run_name="__main__")
"""
"""Runs a program that gets a signal while it waits for messages."""


@pytest.mark.parametrize("name", ["av_listener", "av_policy", "lawful_stack", "live_predictor"])
def test_a_signal_ends_them_without_a_word(name: str) -> None:
    program = REPOSITORY / "examples" / f"{name}.py"
    command = [sys.executable, "-c", SIGNALLED, str(program), str(int(signal.SIGTERM))]
    done = subprocess.run(command, check=False, capture_output=True, text=True, timeout=100)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
