"""Nodes that write files wait for an episode when they run alone with their defaults: they write nothing before it."""

import signal
from pathlib import Path

import pytest
from live_episodes import Domain, finish

DOMAIN = Domain()
WAIT_FOR_NODE = """
import sys, time
import rclpy
rclpy.init()
node = rclpy.create_node("probe")
until = time.monotonic() + 60.0
while sys.argv[1] not in node.get_node_names() and time.monotonic() < until:
    time.sleep(0.05)
print(sys.argv[1] in node.get_node_names())
"""


@pytest.mark.parametrize("name", ["recorder", "kitti_exporter", "detector"])
def test_defaults_neither_refuse_nor_write(name: str, tmp_path: Path) -> None:
    with (
        DOMAIN.running("-m", f"siren_nodes.{name}", cwd=tmp_path) as node,
        DOMAIN.running("-c", WAIT_FOR_NODE, name, cwd=tmp_path) as probe,
    ):
        assert finish(probe).out == "True\n"
        assert node.poll() is None
        node.send_signal(signal.SIGTERM)
        run = finish(node)
    assert run.code in {1, -signal.SIGALRM}  # the latter where DDS needs more than its three seconds to shut down
    assert run.error_lines == [f"{name}: stopped by SIGTERM"]
    assert not list(tmp_path.iterdir())
