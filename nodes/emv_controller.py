"""``emv_controller``: drives the emergency vehicles (Algorithm 1)."""

import sys
from functools import partial
from typing import Any

from siren_ros.data.interfaces import topics, wire
from siren_ros.data.interfaces.conversions import from_traffic_state, to_vehicle_commands
from siren_ros.data.lockstep import Input
from siren_ros.running.generation.episode_setup import behaviour_world
from siren_ros.running.ros.node_configs import EmvControllerConfig
from siren_ros.running.ros.participants.participant import Participant
from siren_ros.running.ros.programs.program import run_program
from siren_ros.simulation.behaviour.emv.controller import EmvState, step_emv
from siren_ros.simulation.scenario.episode import EpisodeDescription


class EmvController(Participant[EmvControllerConfig]):
    """Drives the emergency vehicles by the paper's Algorithm 1."""

    config_type = EmvControllerConfig
    inputs = (Input(topics.TRAFFIC),)
    outputs = (topics.EMV_COMMANDS,)

    def prepare(self, episode: EpisodeDescription, map_xml: bytes) -> None:
        """Read the map and the level."""
        self._world = behaviour_world(episode, map_xml)
        self._state = EmvState()

    def on_step(self, step: int, inputs: dict[str, Any]) -> None:
        """Decide for this step."""
        traffic = wire.content(from_traffic_state, inputs[topics.TRAFFIC.name])
        self._state, commands = step_emv(self._state, traffic, self._world)
        self.send_content(topics.EMV_COMMANDS, step, commands, to_vehicle_commands)


NODE = EmvController
main = partial(run_program, NODE, "emv_controller")

if __name__ == "__main__":
    sys.exit(main())
