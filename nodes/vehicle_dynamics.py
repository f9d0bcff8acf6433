"""``vehicle_dynamics``: turns throttle, brake and steering into poses, and finds collisions."""

import sys
from functools import partial
from typing import Any

from siren_ros.data.interfaces import topics, wire
from siren_ros.data.interfaces.conversions import (
    from_av_control,
    from_traffic_state,
    from_vehicle_commands,
    to_actor_states,
    to_events,
)
from siren_ros.data.lockstep import Input
from siren_ros.running.ros.node_configs import VehicleDynamicsConfig
from siren_ros.running.ros.participants.participant import Participant
from siren_ros.running.ros.programs.program import run_program
from siren_ros.simulation.dynamics.fleet import FleetState, step_fleet
from siren_ros.simulation.dynamics.vehicle_model import load_vehicle_parameters
from siren_ros.simulation.roads.net_parser import parse_road_network
from siren_ros.simulation.scenario.episode import EpisodeDescription
from siren_ros.simulation.world.actors import NO_ACTOR, hash_state
from siren_ros.simulation.world.commands import AvControl, av_commands


class VehicleDynamics(Participant[VehicleDynamicsConfig]):
    """Moves every vehicle: ROS-owned ones by their commands, SUMO-owned ones after SUMO's pose."""

    config_type = VehicleDynamicsConfig
    inputs = (Input(topics.TRAFFIC), Input(topics.EMV_COMMANDS), Input(topics.YIELD_COMMANDS))
    outputs = (topics.ACTORS, topics.EVENTS)

    def prepare(self, episode: EpisodeDescription, map_xml: bytes) -> None:
        """Start with no vehicles; where there is an AV under test, its controller's answers are commands too."""
        left_hand = parse_road_network(map_xml).left_hand
        self._fleet = FleetState.empty(load_vehicle_parameters(episode.files), left_hand=left_hand)
        self._av_id = episode.av_id
        if self._av_id != NO_ACTOR:
            self.join_more([Input(topics.AV_CONTROL, lag_steps=1)])

    def on_step(self, step: int, inputs: dict[str, Any]) -> None:
        """Advance all vehicles by one step."""
        traffic = wire.content(from_traffic_state, inputs[topics.TRAFFIC.name])
        said = [inputs[topic.name] for topic in (topics.EMV_COMMANDS, topics.YIELD_COMMANDS)]
        commands = [wire.content(from_vehicle_commands, message) for message in said]
        if self._av_id in traffic.actor_id:
            answer = inputs.get(topics.AV_CONTROL.name)
            control = AvControl(step - 1) if answer is None else from_av_control(answer)
            commands.append(av_commands(control, step, self._av_id))
        self._fleet, states, events = step_fleet(self._fleet, traffic, commands)
        self.send_content(topics.ACTORS, step, states, to_actor_states)
        happened = step, hash_state(states, traffic.signals), events
        self.send_content(topics.EVENTS, step, happened, lambda content: to_events(*content))


NODE = VehicleDynamics
main = partial(run_program, NODE, "vehicle_dynamics")

if __name__ == "__main__":
    sys.exit(main())
