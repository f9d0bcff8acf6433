"""A node's program ends, also where DDS does not let go of it."""

import signal

import pytest
from live_episodes import Domain, finish

pytest.importorskip("rclpy", reason="needs ROS")

# Sleeps in C without giving up the interpreter's lock, as a destructor may.
STUCK = """
import ctypes
from rclpy.node import Node
from siren_ros.running.ros.programs import program

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
    with Domain().running("-c", STUCK) as process:
        run = finish(process, timeout_s=60.0)
    assert "destroying" in run.out
    assert run.code == -signal.SIGALRM
