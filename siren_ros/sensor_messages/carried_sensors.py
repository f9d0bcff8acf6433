"""The suites of one episode, each on its carrier: rigs in one world, with the messages that they make."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

from siren_ros.interfaces.topics import AV_CARRIER_TOPICS, Topic
from siren_ros.interfaces.transforms import Transform
from siren_ros.roads.road_network import RoadNetwork
from siren_ros.scenario.episode import EpisodeDescription
from siren_ros.sensor_messages.carrier import AV, Carrier, noise_seed, static_transforms
from siren_ros.sensor_messages.observation_messages import ObservationMessages
from siren_ros.sensor_messages.sensor_topics import carriers_of, suite_topics
from siren_ros.sensors.rig.rig import SensorRig
from siren_ros.sensors.suite.look_file import load_look, look_of


@dataclass(frozen=True, eq=False)
class CarriedSensors:
    """A suite on its carrier, ready to measure."""

    rig: SensorRig
    messages: ObservationMessages
    topics: tuple[Topic, ...]
    """That are published beyond those of every carrier."""
    transforms: tuple[Transform, ...]
    """Where the sensors sit."""

    @property
    def carrier(self) -> Carrier:
        """Who carries them."""
        return self.messages.carrier


def carried_sensors(
    episode: EpisodeDescription,
    network: RoadNetwork,
    wants_raw: Callable[[Topic], bool],
    *,
    beside: bool,
) -> Iterator[CarriedSensors]:
    """The sensors of all carriers of an episode, ready in the thread that will measure.

    Args:
        episode: What is said of it.
        network: Its map.
        wants_raw: As ``ObservationMessages`` takes it.
        beside: As ``SensorRig`` takes it.

    Raises:
        InputError: A suite or a look that is not to be had, or sensors inside a building.
    """
    look, scene = load_look(look_of(episode)), None
    for carrier, actor_id, suite in carriers_of(episode):
        messages = ObservationMessages(suite, actor_id, wants_raw, carrier)
        rig = SensorRig(
            suite,
            network,
            episode.seed,
            look=look,
            scene=scene,
            noise_seed=noise_seed(episode.seed, carrier),
            site=episode.site,
            wanted=messages.wanted_labels,
            beside=beside,
        )
        rig.prepare()
        scene = rig.scene
        topics = (*(AV_CARRIER_TOPICS if carrier == AV else ()), *suite_topics(suite, carrier))
        yield CarriedSensors(rig, messages, topics, tuple(static_transforms(suite, carrier, rig.station)))
