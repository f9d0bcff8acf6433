"""The suites of one episode, each mounted on its carrier: rigs in one world, with the messages that they make."""

import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from siren_ros.interfaces import topics
from siren_ros.interfaces.messages import make_message
from siren_ros.interfaces.topics import AV_CARRIER_TOPICS, Topic
from siren_ros.interfaces.transforms import Transform, to_tf
from siren_ros.roads.road_network import RoadNetwork
from siren_ros.scenario.episode import EpisodeDescription
from siren_ros.sensor_messages.carrier import (
    AV,
    Carrier,
    frames_of,
    motion_of,
    noise_seed,
    row_of_carrier,
    static_transforms,
)
from siren_ros.sensor_messages.observation_messages import ObservationMessages, Published
from siren_ros.sensor_messages.sensor_topics import carriers_of, suite_topics
from siren_ros.sensors.navigation.wheel_odometry import WheelOdometry
from siren_ros.sensors.rig.rig import SensorRig
from siren_ros.sensors.suite.look_file import load_look, look_of
from siren_ros.world.actors import ActorStates


@dataclass(frozen=True, eq=False)
class MountedSuite:
    """A suite on its carrier, ready to measure."""

    rig: SensorRig
    messages: ObservationMessages
    topics: tuple[Topic, ...]
    """Topics of this suite, beyond those that every carrier has."""
    transforms: tuple[Transform, ...]
    """Mounts of the sensors."""
    wheels: WheelOdometry

    @property
    def carrier(self) -> Carrier:
        """The vehicle with the suite."""
        return self.messages.carrier

    def locate(self, states: ActorStates) -> tuple[tuple[Transform, ...], Published]:
        """Frames and odometry of the carrier at a step; call it at every step.

        Raises:
            EpisodeError: The carrier has left the map.
        """
        motion = motion_of(states, row_of_carrier(states, self.messages.carrier_id))
        odometry = self.wheels.measure(states.step, motion)
        return frames_of(motion, odometry, self.carrier), self.messages.odometry(states.step, odometry)


def mounted_suites(
    episode: EpisodeDescription,
    network: RoadNetwork,
    wants_raw: Callable[[Topic], bool],
    *,
    in_background: bool,
) -> Iterator[MountedSuite]:
    """The suites of all carriers of an episode. The calling thread has to be the one that will measure.

    Args:
        episode: The episode's description.
        network: Its map.
        wants_raw: As ``ObservationMessages`` takes it.
        in_background: As ``SensorRig`` takes it.

    Raises:
        InputError: A suite or a look that cannot be loaded, or sensors inside a building.
    """
    look, scene = load_look(look_of(episode), episode.files), None
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
            in_background=in_background,
        )
        rig.prepare()
        scene = rig.scene
        topics_ = (*(AV_CARRIER_TOPICS if carrier == AV else ()), *suite_topics(suite, carrier))
        mounts = tuple(static_transforms(suite, carrier, rig.station))
        yield MountedSuite(rig, messages, topics_, mounts, WheelOdometry(noise_seed(episode.seed, carrier)))


def setup_messages(suites: Sequence[MountedSuite]) -> Iterator[Published]:
    """Messages before the first step: where the sensors sit, and how this machine simulates them."""
    yield topics.TF_STATIC, to_tf(0, [transform for suite in suites for transform in suite.transforms])
    accounts = {suite.carrier.name: suite.rig.account for suite in suites}
    yield topics.SENSING, make_message(topics.SENSING.type_name, data=json.dumps(accounts, sort_keys=True))
