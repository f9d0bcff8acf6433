"""``viewer``: shows a running episode in the browser; also ``siren view --live``."""

import os
import sys
import webbrowser
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

from rclpy.node import Node

from siren_ros.data.interfaces import wire
from siren_ros.data.interfaces.topics import Topic
from siren_ros.errors import SirenError
from siren_ros.reports.episode_page.live import LIVE_TOPICS, LiveFeed, LiveServer
from siren_ros.running.ros.node_configs import ViewerConfig
from siren_ros.running.ros.parameters import declare_config
from siren_ros.running.ros.programs.program import run_program
from siren_ros.running.ros.transport.endpoints import create_input

LESS_URGENT: Final = 10
"""Added to the process's nice value: where processors are short, the episode goes first."""


class Viewer(Node):
    """Hears an episode and serves its page; it publishes nothing, and no participant waits for it."""

    config_type = ViewerConfig
    ends_by_signal = True

    def __init__(self, name: str, **node_options: Any) -> None:
        """Listen to episodes and to browsers.

        Raises:
            InputError: A parameter, or a port that is taken.
        """
        super().__init__(name, **node_options)
        os.nice(LESS_URGENT)
        config = declare_config(self, self.config_type)
        self.finished = False
        self._feed = LiveFeed()
        self._server = LiveServer(self._feed, config.port)
        for known_as, topic in LIVE_TOPICS.items():
            wire.get_ready(topic)
            depth = 0 if topic.latched else config.depth
            create_input(self, topic, partial(self._on_message, known_as, topic), depth=depth)
        sys.stdout.write(f"{self._server.address}\n")
        sys.stdout.flush()
        self._folder = TemporaryDirectory(prefix="siren_view_")
        if config.browser:
            webbrowser.open(self._server.write_door(Path(self._folder.name)).as_uri())

    def _on_message(self, known_as: str, topic: Topic, cdr: bytes) -> None:
        try:
            self._feed.add(known_as, wire.decode(topic, cdr))
        except SirenError as error:
            self.get_logger().warning(str(error))

    def flush(self, timeout_s: float) -> None:
        """Nothing was published."""

    def close_early(self, reason: str) -> None:  # noqa: ARG002 - the interface of all programs
        """Let the browsers go."""
        self._server.close()
        self._folder.cleanup()


NODE = Viewer
main = partial(run_program, NODE, "viewer")

if __name__ == "__main__":
    sys.exit(main())
