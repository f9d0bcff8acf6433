"""``yield_manager``: drives the civilians that yield (Algorithm 2)."""

import sys
from functools import partial
from typing import Any

from siren_ros.data.interfaces import topics, wire
from siren_ros.data.interfaces.conversions import from_traffic_state, to_vehicle_commands
from siren_ros.data.lockstep import Input
from siren_ros.running.generation.episode_setup import behaviour_world
from siren_ros.running.ros.node_configs import YieldManagerConfig
from siren_ros.running.ros.participants.participant import Participant
from siren_ros.running.ros.programs.program import run_program
from siren_ros.simulation.behaviour.civilians.yield_manager import YieldState, step_yield
from siren_ros.simulation.scenario.episode import EpisodeDescription


class YieldManager(Participant[YieldManagerConfig]):
    """Drives the civilians that yield, by the paper's Algorithm 2."""

    config_type = YieldManagerConfig
    inputs = (Input(topics.TRAFFIC),)
    outputs = (topics.YIELD_COMMANDS,)

    def prepare(self, episode: EpisodeDescription, map_xml: bytes) -> None:
        """Read the map, the level and the drivers' preset."""
        self._world = behaviour_world(episode, map_xml)
        self._state = YieldState()

    def on_step(self, step: int, inputs: dict[str, Any]) -> None:
        """Decide for this step."""
        traffic = wire.content(from_traffic_state, inputs[topics.TRAFFIC.name])
        self._state, commands = step_yield(self._state, traffic, self._world)
        self.send_content(topics.YIELD_COMMANDS, step, commands, to_vehicle_commands)


NODE = YieldManager
main = partial(run_program, NODE, "yield_manager")

if __name__ == "__main__":
    sys.exit(main())
