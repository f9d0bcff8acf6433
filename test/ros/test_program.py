"""A node's program ends, also where DDS does not let go of it."""

import os
import signal
import subprocess
import sys

import pytest
from dds_domains import own_domain

pytest.importorskip("rclpy", reason="needs ROS")

# Sleeps in C without giving up the interpreter's lock, as a destructor does that waits for a lock in shared memory.
STUCK = """
import ctypes
from rclpy.node import Node
from siren_ros.ros import program

class Stuck(Node):
    finished = True
    def flush(self, timeout_s): pass
    def close_early(self, reason): pass
    def destroy_node(self):
        print("destroying", flush=True)
        ctypes.PyDLL(None).sleep(1000)

program.SHUTDOWN_S = 1
program.run_program(Stuck, "stuck")
"""


def test_a_node_that_cannot_be_destroyed_does_not_stay() -> None:
    environment = {**os.environ, "ROS_DOMAIN_ID": str(own_domain()), "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
    command = [sys.executable, "-c", STUCK]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=60.0, check=False)
    assert "destroying" in done.stdout
    assert done.returncode == -signal.SIGALRM
