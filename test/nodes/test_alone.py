"""Nodes that write files wait for an episode when they run alone with their defaults: they write nothing before it."""

import signal
import subprocess
from contextlib import ExitStack
from pathlib import Path

from live_episodes import Domain, finish

DOMAIN = Domain(subprocess.Popen)
NODES = ("recorder", "kitti_exporter", "detector")
WAIT_FOR_NODES = """
import sys, time
import rclpy
rclpy.init()
node = rclpy.create_node("probe")
until = time.monotonic() + 60.0
while not {*sys.argv[1:]} <= {*node.get_node_names()} and time.monotonic() < until:
    time.sleep(0.05)
print({*sys.argv[1:]} <= {*node.get_node_names()})
"""


def test_defaults_neither_refuse_nor_write(tmp_path: Path) -> None:
    with ExitStack() as started:
        nodes = [started.enter_context(DOMAIN.running("-m", f"siren_nodes.{name}", cwd=tmp_path)) for name in NODES]
        probe = started.enter_context(DOMAIN.running("-c", WAIT_FOR_NODES, *NODES, cwd=tmp_path))
        assert finish(probe).out == "True\n"
        assert [node.poll() for node in nodes] == [None] * len(nodes)
        for node in nodes:
            node.send_signal(signal.SIGTERM)
        runs = [finish(node) for node in nodes]
    for name, run in zip(NODES, runs, strict=True):
        assert run.code in {1, -signal.SIGALRM}  # the latter where DDS needs more than its three seconds to shut down
        assert run.error_lines == [f"{name}: stopped by SIGTERM"]
    assert not list(tmp_path.iterdir())
