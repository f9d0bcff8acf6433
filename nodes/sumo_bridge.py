"""``sumo_bridge``: makes the episode, runs SUMO, and mirrors the vehicles that ROS drives into it."""

import sys
from dataclasses import replace
from functools import partial
from typing import Any

from siren_ros.data.interfaces import topics, wire
from siren_ros.data.interfaces.conversions import (
    EpisodeClosing,
    from_actor_states,
    to_episode_description,
    to_path,
    to_traffic_state,
)
from siren_ros.data.interfaces.messages import make_message
from siren_ros.data.lockstep import Input
from siren_ros.running.generation.episode_setup import set_up_episode
from siren_ros.running.ros.node_configs import SumoBridgeConfig
from siren_ros.running.ros.participants.participant import Participant
from siren_ros.running.ros.programs.program import run_program
from siren_ros.simulation.scenario.episode import EpisodeRequest
from siren_ros.simulation.scenario.sealing import told
from siren_ros.simulation.traffic.demand.av_way import av_way
from siren_ros.simulation.traffic.observation import check_no_teleport, check_residual
from siren_ros.simulation.traffic.simulation import SumoSimulation
from siren_ros.simulation.world.actors import ActorDescription


class SumoBridge(Participant[SumoBridgeConfig]):
    """Owns SUMO. Says once what the episode is, then at every step what SUMO does."""

    config_type = SumoBridgeConfig
    inputs = (Input(topics.CLOCK), Input(topics.ACTORS, lag_steps=1))
    outputs = (topics.EPISODE, topics.MAP, topics.TRAFFIC, topics.ROSTER)
    needs_episode = False

    def __init__(self, name: str, **node_options: Any) -> None:
        super().__init__(name, **node_options)
        setup = set_up_episode(EpisodeRequest.within(self.config))
        self._simulation = SumoSimulation(
            setup.compiled_map, setup.network, setup.plan, setup.level, seed=setup.description.seed
        )
        self._roster: tuple[ActorDescription, ...] = ()
        map_xml = setup.compiled_map.read_bytes().decode()
        self.send(topics.EPISODE, to_episode_description(told(setup.description)))
        self.send(topics.MAP, make_message(topics.MAP.type_name, data=map_xml))
        if setup.plan.av:
            self.add_output(topics.AV_ROUTE)
            self.send(topics.AV_ROUTE, to_path(av_way(setup.network, setup.plan)))

    def on_step(self, step: int, inputs: dict[str, Any]) -> None:
        """Mirror the simulated poses into SUMO, let it step, and say where it is now."""
        message = inputs.get(topics.ACTORS.name)
        states = None if message is None else wire.content(from_actor_states, message)
        if states is not None:
            check_residual(states, self.config.residual_limit_m)
        traffic = self._simulation.step(step, states)
        check_no_teleport(traffic)
        self.send_content(topics.TRAFFIC, step, traffic, to_traffic_state)
        if traffic.spawned:
            self._roster += traffic.spawned
            self.send(topics.ROSTER, to_traffic_state(replace(traffic, spawned=self._roster)))

    def close(self, closing: EpisodeClosing) -> None:  # noqa: ARG002 - the interface of all nodes
        """End SUMO."""
        self._simulation.close()


NODE = SumoBridge
main = partial(run_program, NODE, "sumo_bridge")

if __name__ == "__main__":
    sys.exit(main())
