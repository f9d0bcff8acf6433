"""``sensor_sim``: vehicle states in, what the carrier's sensors see out, with ground truth and frames."""

import json
import sys
from typing import Any, Final, TypeAlias

from siren_ros.interfaces import topics
from siren_ros.interfaces.conversions import from_actor_states, from_traffic_state
from siren_ros.interfaces.lockstep_reports import Phase
from siren_ros.interfaces.messages import make_message
from siren_ros.interfaces.transforms import to_tf
from siren_ros.lockstep.tick_join import Input
from siren_ros.roads.net_parser import parse_road_network
from siren_ros.ros.parameters.node_configs import SensorSimConfig
from siren_ros.ros.participants.participant import Participant
from siren_ros.ros.programs.program import run_participant
from siren_ros.ros.transport import wire
from siren_ros.ros.transport.wall_timer import create_wall_timer
from siren_ros.scenario.episode import EpisodeDescription
from siren_ros.sensor_messages.carried_sensors import CarriedSensors, carried_sensors
from siren_ros.sensor_messages.observation_messages import shared_messages
from siren_ros.sensors.rig.observations import Observations, Sensing
from siren_ros.world.actors import ActorDescription, ActorStates

LATE_S: Final = 0.1
"""What is measured at a step waits no longer than this for the next step."""
Seen: TypeAlias = tuple[ActorStates, list[Observations]]


class SensorSim(Participant[SensorSimConfig]):
    """Senses the world from the first emergency vehicle, and from the AV under test where there is one."""

    config_type = SensorSimConfig
    inputs = (Input(topics.TRAFFIC), Input(topics.ACTORS))
    outputs = topics.CARRIER_TOPICS

    def __init__(self, name: str, **node_options: Any) -> None:
        super().__init__(name, **node_options)
        self._actors: dict[int, ActorDescription] = {}
        self._carried: list[CarriedSensors] = []
        self._begun: tuple[ActorStates, list[Sensing]] | None = None
        self._published: list[int] = []
        self._busy_s = 0.0
        self._late = create_wall_timer(self, LATE_S, self._no_more_steps)
        self._late.cancel()

    def prepare(self, episode: EpisodeDescription, map_xml: bytes) -> None:
        """Build the scene and say where the sensors sit."""
        network = parse_road_network(map_xml)
        self._carried = list(carried_sensors(episode, network, self.has_listeners, beside=self.config.trails))
        for carried in self._carried:
            for note in carried.rig.notes:
                self.get_logger().warning(note)
            for topic in carried.topics:
                self.add_output(topic)
        transforms = [transform for carried in self._carried for transform in carried.transforms]
        accounts = {carried.carrier.name: carried.rig.account for carried in self._carried}
        self.send(topics.TF_STATIC, to_tf(0, transforms))
        self.send(topics.SENSING, make_message(topics.SENSING.type_name, data=json.dumps(accounts, sort_keys=True)))

    def on_step(self, step: int, inputs: dict[str, Any]) -> None:  # noqa: ARG002 - the interface of all nodes
        """Publish what is due at this step: at once, or within the next step where the sensors may trail."""
        earlier = self._finish()
        traffic = wire.content(from_traffic_state, inputs[topics.TRAFFIC.name])
        states = wire.content(from_actor_states, inputs[topics.ACTORS.name])
        self._actors.update({actor.actor_id: actor for actor in traffic.spawned})
        carriers = [(carried.carrier, carried.messages.carrier_id) for carried in self._carried]
        for topic, message in shared_messages(states, self._actors, carriers):
            self.send(topic, message)
        begun = [
            carried.rig.begin(states, self._actors, traffic.signals, carried.messages.carrier_id)
            for carried in self._carried
        ]
        self._begun = (states, begun)
        self._publish(earlier)
        if self.config.trails and any(sensing.under_way for sensing in begun):
            self._late.reset()
        else:
            self._publish(self._finish())

    def _finish(self) -> Seen | None:
        """What the step that has begun measured, once all of it is there; None where none has."""
        if self._begun is None:
            return None
        (states, begun), self._begun = self._begun, None
        return states, [sensing.finish() for sensing in begun]

    def _publish(self, step: Seen | None) -> None:
        if step is None:
            return
        states, seen = step
        for carried, observations in zip(self._carried, seen, strict=True):
            for topic, message in carried.messages.of_step(states, observations):
                self.send(topic, message)
        self._published.append(states.step)

    def step_finished(self, step: int, busy_s: float) -> None:  # noqa: ARG002 - those that were published count
        """Report the steps whose messages are out."""
        self._busy_s += busy_s
        while self._published:
            super().step_finished(self._published.pop(0), self._busy_s)
            self._busy_s = 0.0

    def _no_more_steps(self) -> None:
        """Publish what was measured at a step that no other follows, or not soon."""
        self._late.cancel()
        if self.finished:
            return
        self._guarded(self.steps_done, Phase.STEP, lambda: self._publish(self._finish()))
        self.step_finished(self.steps_done, 0.0)


NODE = SensorSim


def main() -> int:
    """Run the node as a program of its own."""
    return run_participant(NODE, "sensor_sim")


if __name__ == "__main__":
    sys.exit(main())
