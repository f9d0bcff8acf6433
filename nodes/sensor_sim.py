"""``sensor_sim``: vehicle states in, what the carrier's sensors see out, with ground truth and frames."""

import json
import sys
from typing import Any

from siren_ros.interfaces import topics
from siren_ros.interfaces.conversions import from_actor_states, from_traffic_state
from siren_ros.interfaces.tick_join import Input
from siren_ros.interfaces.transforms import Transform, to_tf
from siren_ros.ros import wire
from siren_ros.ros.node_configs import SensorSimConfig
from siren_ros.ros.participant import Participant
from siren_ros.ros.program import run_participant
from siren_ros.sensors.carrier import AV, noise_seed, static_transforms
from siren_ros.sensors.look_file import load_look, look_of
from siren_ros.sensors.observation_messages import ObservationMessages, shared_messages
from siren_ros.sensors.rig import SensorRig
from siren_ros.sensors.sensor_topics import AV_CARRIER_TOPICS, CARRIER_TOPICS, carriers_of, suite_topics
from siren_ros.world.actors import ActorDescription
from siren_ros.world.episode import EpisodeDescription
from siren_ros.world.net_parser import parse_road_network


class SensorSim(Participant[SensorSimConfig]):
    """Senses the world from the first emergency vehicle, and from the AV under test where there is one."""

    config_type = SensorSimConfig
    inputs = (Input(topics.TRAFFIC), Input(topics.ACTORS))
    outputs = CARRIER_TOPICS

    def prepare(self, episode: EpisodeDescription, map_xml: bytes) -> None:
        """Build the scene and say where the sensors sit."""
        network, factory, scene = parse_road_network(map_xml), wire.factory(), None
        look = load_look(look_of(episode))
        self._actors: dict[int, ActorDescription] = {}
        self._carriers: list[tuple[SensorRig, ObservationMessages]] = []
        transforms: list[Transform] = []
        accounts: dict[str, object] = {}
        for carrier, actor_id, suite in carriers_of(episode):
            messages = ObservationMessages(factory, suite, actor_id, self.has_listeners, carrier)
            rig = SensorRig(
                suite,
                network,
                episode.seed,
                look=look,
                scene=scene,
                noise_seed=noise_seed(episode.seed, carrier),
                site=episode.site,
                wanted=messages.wanted_labels,
            )
            rig.prepare()
            for note in rig.notes:
                self.get_logger().warning(note)
            scene, accounts[carrier.name] = rig.scene, rig.account
            self._carriers.append((rig, messages))
            for topic in (*(AV_CARRIER_TOPICS if carrier == AV else ()), *suite_topics(suite, carrier)):
                self.add_output(topic)
            transforms.extend(static_transforms(suite, carrier, rig.station))
        self.send(topics.TF_STATIC, to_tf(factory, 0, transforms))
        self.send(topics.SENSING, factory.make(topics.SENSING.type_name, data=json.dumps(accounts, sort_keys=True)))

    def on_step(self, step: int, inputs: dict[str, Any]) -> None:  # noqa: ARG002 - the interface of all nodes
        """Publish what is due at this step."""
        traffic = wire.content(from_traffic_state, inputs[topics.TRAFFIC.name])
        states = wire.content(from_actor_states, inputs[topics.ACTORS.name])
        self._actors.update({actor.actor_id: actor for actor in traffic.spawned})
        carriers = [(messages.carrier, messages.carrier_id) for _, messages in self._carriers]
        for topic, message in shared_messages(wire.factory(), states, self._actors, carriers):
            self.send(topic, message)
        for rig, messages in self._carriers:
            seen = rig.observe(states, self._actors, traffic.signals, messages.carrier_id)
            for topic, message in messages.of_step(states, seen):
                self.send(topic, message)


NODE = SensorSim


def main() -> int:
    """Run the node as a program of its own."""
    return run_participant(NODE, "sensor_sim")


if __name__ == "__main__":
    sys.exit(main())
