"""``sensor_sim``: vehicle states in, what the carrier's sensors see out, with ground truth and frames."""

import sys
from typing import Any

from siren_ros.interfaces import topics
from siren_ros.interfaces.conversions import from_actor_states, from_traffic_state
from siren_ros.interfaces.tick_join import Input
from siren_ros.interfaces.transforms import to_tf
from siren_ros.ros import wire
from siren_ros.ros.node_configs import SensorSimConfig
from siren_ros.ros.participant import Participant
from siren_ros.ros.program import run_participant
from siren_ros.sensors.carrier import static_transforms
from siren_ros.sensors.observation_messages import ObservationMessages
from siren_ros.sensors.rig import SensorRig
from siren_ros.sensors.sensor_topics import CARRIER_TOPICS, suite_topics
from siren_ros.sensors.suite import load_suite
from siren_ros.world.actors import ActorDescription
from siren_ros.world.episode import EpisodeDescription
from siren_ros.world.net_parser import parse_road_network


class SensorSim(Participant[SensorSimConfig]):
    """Senses the world from the first emergency vehicle."""

    config_type = SensorSimConfig
    inputs = (Input(topics.TRAFFIC), Input(topics.ACTORS))
    outputs = CARRIER_TOPICS

    def prepare(self, episode: EpisodeDescription, map_xml: bytes) -> None:
        """Build the scene and say where the sensors sit."""
        suite = load_suite(episode.sensor_suite)
        self._carrier_id = episode.emv_ids[0]
        self._actors: dict[int, ActorDescription] = {}
        self._rig = SensorRig(suite, parse_road_network(map_xml), episode.seed)
        self._rig.prepare()
        self._messages = ObservationMessages(wire.factory(), suite, self._carrier_id, self.has_listeners)
        for topic in suite_topics(suite):
            self.add_output(topic)
        self.send(topics.TF_STATIC, to_tf(wire.factory(), 0, static_transforms(suite)))

    def on_step(self, step: int, inputs: dict[str, Any]) -> None:  # noqa: ARG002 - the interface of all nodes
        """Publish what is due at this step."""
        traffic = from_traffic_state(inputs[topics.TRAFFIC.name])
        states = from_actor_states(inputs[topics.ACTORS.name])
        self._actors.update({actor.actor_id: actor for actor in traffic.spawned})
        seen = self._rig.observe(states, self._actors, traffic.signals, self._carrier_id)
        for topic, message in self._messages.of_step(states, self._actors, seen):
            self.send(topic, message)


NODE = SensorSim


def main() -> int:
    """Run the node as a program of its own."""
    return run_participant(NODE, "sensor_sim")


if __name__ == "__main__":
    sys.exit(main())
