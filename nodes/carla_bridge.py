"""``carla_bridge``: lets a CARLA server sense, in the place of ``sensor_sim`` and with its topics and name."""

import sys
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from functools import partial
from typing import Any

from siren_nodes.sensor_sim import SensorSim  # type: ignore[import-not-found] # installed under this name
from siren_ros.data.interfaces.conversions import EpisodeClosing
from siren_ros.data.sensor_messages.mounted_suite import MountedSuite, Published
from siren_ros.errors import InputError
from siren_ros.running.carla.session import CarlaSession
from siren_ros.running.ros.programs.program import run_program
from siren_ros.simulation.roads.road_network import RoadNetwork
from siren_ros.simulation.scenario.episode import EpisodeDescription
from siren_ros.simulation.world.actors import ActorStates, SignalState


class CarlaBridge(SensorSim):
    """Shows each step in the server, ticks it once, and publishes what its sensors measured."""

    def __init__(self, name: str, **node_options: Any) -> None:
        super().__init__(name, **node_options)
        self._open = ExitStack()
        if not self.config.carla:
            raise InputError("carla", self.config.carla, "HOST:PORT of a running CARLA server")

    def mounted(self, episode: EpisodeDescription, network: RoadNetwork) -> Sequence[MountedSuite]:
        """Connect to the server and mount the suites there."""
        self._session = self._open.enter_context(CarlaSession(self.config.carla))
        return self._session.suites(episode, network, self.has_listeners)

    def measured(self, states: ActorStates, signals: Sequence[SignalState]) -> Iterator[Published]:
        """Messages of a step."""
        return self._session.messages(self.sensing, states, self.actors, signals)

    def close(self, closing: EpisodeClosing) -> None:
        """Leave the server as it was."""
        self._open.close()
        super().close(closing)

    def destroy_node(self) -> None:
        """Leave the server as it was, however the episode ended."""
        self._open.close()
        super().destroy_node()


NODE = CarlaBridge
main = partial(run_program, NODE, "sensor_sim")  # type: ignore[arg-type] # its base is not known here

if __name__ == "__main__":
    sys.exit(main())
