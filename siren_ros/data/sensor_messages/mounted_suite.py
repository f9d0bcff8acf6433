"""The suites of one episode, each on its carrier, in one shared world; they measure and make messages.

Sensing goes step by step; a step's measurements may end after the next step has begun.
"""

import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

from siren_ros.data.interfaces import topics
from siren_ros.data.interfaces.messages import make_message
from siren_ros.data.interfaces.topics import AV_CARRIER_TOPICS, Topic
from siren_ros.data.interfaces.transforms import Transform, to_tf
from siren_ros.data.sensor_messages.observation_messages import ObservationMessages, Published, shared_messages
from siren_ros.data.sensor_messages.sensor_topics import (
    AV,
    Carrier,
    carriers_of,
    frames_of,
    motion_of,
    noise_seed,
    row_of_carrier,
    static_transforms,
    suite_topics,
)
from siren_ros.sensing.look import load_look, look_of
from siren_ros.sensing.navigation import WheelOdometry
from siren_ros.sensing.rig import Observations, Sensing, SensorRig
from siren_ros.sensing.scene.kerbside import scene_config_of
from siren_ros.simulation.roads.road_network import RoadNetwork
from siren_ros.simulation.scenario.episode import EpisodeDescription
from siren_ros.simulation.world.actors import ActorDescription, ActorStates
from siren_ros.simulation.world.traffic_state import SignalState


@dataclass(frozen=True, eq=False)
class MountedSuite:
    """A suite on its carrier, ready to measure."""

    rig: SensorRig
    messages: ObservationMessages
    topics: tuple[Topic, ...]
    """Topics of this suite, besides those that every carrier has."""
    transforms: tuple[Transform, ...]
    """Mounts of the sensors."""
    wheels: WheelOdometry

    @property
    def carrier(self) -> Carrier:
        """The vehicle with the suite."""
        return self.messages.carrier

    def locate(self, states: ActorStates) -> tuple[tuple[Transform, ...], Published]:
        """Frames and odometry of the carrier; call it at every step. EpisodeError if the carrier has left the map."""
        motion = motion_of(states, row_of_carrier(states, self.messages.carrier_id))
        odometry = self.wheels.measure(states.step, motion)
        return frames_of(motion, odometry, self.carrier), self.messages.odometry(states.step, odometry)


def mounted_suites(
    episode: EpisodeDescription, network: RoadNetwork, wants_raw: Callable[[Topic], bool], *, in_background: bool
) -> Iterator[MountedSuite]:
    """Make the suites of all carriers of an episode. Call it in the thread that will measure.

    ``wants_raw`` is as ``ObservationMessages`` takes it, ``in_background`` as ``SensorRig`` does.

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
            scene_config_of(episode.template_values),
            look=look,
            scene=scene,
            noise_seed=noise_seed(episode.seed, carrier),
            site=episode.site,
            label_kinds=messages.label_kinds,
            in_background=in_background,
        )
        rig.prepare()
        scene = rig.scene
        topics_ = (*(AV_CARRIER_TOPICS if carrier == AV else ()), *suite_topics(suite, carrier))
        mounts = tuple(static_transforms(suite, carrier, rig.station))
        yield MountedSuite(rig, messages, topics_, mounts, WheelOdometry(noise_seed(episode.seed, carrier)))


def setup_messages(suites: Sequence[MountedSuite]) -> Iterator[Published]:
    """Messages before the first step: mounts of the sensors, and how this machine simulates them."""
    yield topics.TF_STATIC, to_tf(0, [transform for suite in suites for transform in suite.transforms])
    accounts = {suite.carrier.name: suite.rig.account for suite in suites}
    yield topics.SENSING, make_message(topics.SENSING.type_name, data=json.dumps(accounts, sort_keys=True))


class TrailingSensing:
    """Measures with the suites of an episode, and tracks for which steps all messages were published."""

    def __init__(self, suites: Sequence[MountedSuite], *, trails: bool) -> None:
        """Begin before the first step; ``trails`` allows a step's measurements to end during the next step."""
        self._suites = tuple(suites)
        self._trails = trails
        self._begun: tuple[ActorStates, list[Sensing]] | None = None
        self._unreported: list[int] = []
        self._busy_s = 0.0

    @property
    def under_way(self) -> bool:
        """Whether a step's measurements have begun and are not published yet."""
        return self._begun is not None

    def step(
        self, states: ActorStates, actors: Mapping[int, ActorDescription], signals: Iterable[SignalState]
    ) -> Iterator[Published]:
        """Begin to measure at a step; yield the messages that can be published now, each with its topic.

        The measurements of the step before end first. Their messages come after this step's measurements have begun,
        so that publishing runs in parallel with them. Raises EpisodeError where a carrier has left the map.
        """
        earlier = self._end()
        located = [suite.locate(states) for suite in self._suites]
        yield from shared_messages(states, actors, [transform for transforms, _ in located for transform in transforms])
        yield from (odometry for _, odometry in located)
        begun = [suite.rig.begin(states, actors, signals, suite.messages.carrier_id) for suite in self._suites]
        self._begun = (states, begun)
        yield from earlier
        if not self._trails or not any(sensing.under_way for sensing in begun):
            yield from self.finish()

    def finish(self) -> Iterator[Published]:
        """Wait for the measurements that have begun and yield their messages; none if none has begun."""
        yield from self._end()

    def finished_steps(self, busy_s: float) -> Iterator[tuple[int, float]]:
        """Steps whose messages were all published, each once.

        With each comes the wall time spent on sensing since the last call.
        """
        self._busy_s += busy_s
        while self._unreported:
            yield self._unreported.pop(0), self._busy_s
            self._busy_s = 0.0

    def _end(self) -> Iterator[Published]:
        """Wait now for the measurements that have begun; messages are made when they are requested."""
        if self._begun is None:
            return iter(())
        (states, begun), self._begun = self._begun, None
        return self._messages(states, [sensing.finish() for sensing in begun])

    def _messages(self, states: ActorStates, seen: Sequence[Observations]) -> Iterator[Published]:
        for suite, observations in zip(self._suites, seen, strict=True):
            yield from suite.messages.of_step(states, observations)
        self._unreported.append(states.step)
