"""``sensor_sim``: simulates the sensors, and publishes labels, frames and markers."""

import sys
from collections.abc import Iterator, Sequence
from functools import partial
from typing import Any, Final

from siren_ros.data.interfaces import topics, wire
from siren_ros.data.interfaces.conversions import Phase, from_actor_states, from_traffic_state
from siren_ros.data.lockstep import Input
from siren_ros.data.sensor_messages.mounted_suite import (
    MountedSuite,
    Published,
    TrailingSensing,
    mounted_suites,
    setup_messages,
)
from siren_ros.running.ros.node_configs import SensorSimConfig
from siren_ros.running.ros.participants.participant import Participant
from siren_ros.running.ros.programs.program import run_program
from siren_ros.running.ros.transport.endpoints import create_wall_timer
from siren_ros.simulation.roads.net_parser import parse_road_network
from siren_ros.simulation.roads.road_network import RoadNetwork
from siren_ros.simulation.scenario.episode import EpisodeDescription
from siren_ros.simulation.world.actors import ActorDescription, ActorStates, SignalState

LATE_S: Final = 0.1
"""Measurements of a step wait no longer than this for the next step before they are published."""


class SensorSim(Participant[SensorSimConfig]):
    """Senses the world from the first emergency vehicle, and from the AV under test where there is one."""

    config_type = SensorSimConfig
    inputs = (Input(topics.TRAFFIC), Input(topics.ACTORS))
    outputs = topics.CARRIER_TOPICS

    def __init__(self, name: str, **node_options: Any) -> None:
        super().__init__(name, **node_options)
        self.actors: dict[int, ActorDescription] = {}
        self.sensing = TrailingSensing((), trails=False)
        self._late = create_wall_timer(self, LATE_S, self._no_more_steps)
        self._late.cancel()

    def prepare(self, episode: EpisodeDescription, map_xml: bytes) -> None:
        """Build the scene and say where the sensors sit."""
        suites = self.mounted(episode, parse_road_network(map_xml))
        for suite in suites:
            for note in suite.rig.notes:
                self.get_logger().warning(note)
            for topic in suite.topics:
                self.add_output(topic)
        self.sensing = TrailingSensing(suites, trails=self.config.trails)
        for topic, message in setup_messages(suites):
            self.send(topic, message)

    def mounted(self, episode: EpisodeDescription, network: RoadNetwork) -> Sequence[MountedSuite]:
        """The suites of the episode."""
        trails = self.config.trails
        return tuple(mounted_suites(episode, network, self.has_listeners, in_background=trails))

    def measured(self, states: ActorStates, signals: Sequence[SignalState]) -> Iterator[Published]:
        """Messages that are ready at a step."""
        return self.sensing.step(states, self.actors, signals)

    def on_step(self, step: int, inputs: dict[str, Any]) -> None:  # noqa: ARG002 - the interface of all nodes
        """Publish the messages that are ready; those of this step at once, or within the next where sensors trail."""
        traffic = wire.content(from_traffic_state, inputs[topics.TRAFFIC.name])
        states = wire.content(from_actor_states, inputs[topics.ACTORS.name])
        self.actors.update({actor.actor_id: actor for actor in traffic.spawned})
        for topic, message in self.measured(states, traffic.signals):
            self.send(topic, message)
        if self.sensing.under_way:
            self._late.reset()

    def step_finished(self, step: int, busy_s: float) -> None:  # noqa: ARG002 - those that were published count
        """Report the steps whose messages are out."""
        for finished, spent_s in self.sensing.finished_steps(busy_s):
            super().step_finished(finished, spent_s)

    def _no_more_steps(self) -> None:
        """Publish the last measurements where no other step follows, or not soon."""
        self._late.cancel()
        if not self.finished:
            self._guarded(self.steps_done, Phase.STEP, self._publish_rest)
            self.step_finished(self.steps_done, 0.0)

    def _publish_rest(self) -> None:
        for topic, message in self.sensing.finish():
            self.send(topic, message)


NODE = SensorSim
main = partial(run_program, NODE, "sensor_sim")

if __name__ == "__main__":
    sys.exit(main())
